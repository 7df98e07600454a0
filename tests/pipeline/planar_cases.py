"""The case of a scenario in a plane, for tests of the stages from there on."""

from pipeline.model import Case
from pipeline.scenario.model import Scenario
from pipeline.stages.places import fetched_plane, unsimplified
from pipeline.stages.project import project


def case_of(scenario: Scenario) -> Case:
    """Return the one case of a scenario in a plane."""
    assert scenario.plane is not None
    fetched = fetched_plane(scenario.plane, scenario.scale)
    (case,) = project(scenario, fetched, unsimplified(fetched.land))
    return case
