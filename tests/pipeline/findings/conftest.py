"""The runs of the formats' tests."""

from tests.pipeline.formats.conftest import any_run, planar_result, result

__all__ = ["any_run", "planar_result", "result"]
