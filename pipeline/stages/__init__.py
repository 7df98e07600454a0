"""The six stages, a file each: fetch, simplify, project, plan, evaluate, write."""
