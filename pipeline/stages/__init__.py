"""The six stages, one file each: fetch, simplify, project, plan, evaluate, write."""
