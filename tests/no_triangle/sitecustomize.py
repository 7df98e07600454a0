"""Hide the package `triangle`, as on a machine where the extra is not installed.

With this folder on PYTHONPATH, Python runs this file when it starts, and so does every process
that it starts.
"""

import sys

sys.modules["triangle"] = None  # type: ignore[assignment]  # the documented way to refuse an import
