"""The baselines are those of ompl, which has no wheels for the newest Python."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("ompl") else ["test_*.py"]
