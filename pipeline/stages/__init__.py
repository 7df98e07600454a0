"""The seven stages, one file each: fetch, simplify, project, choose, plan, compare, write."""
