"""One table of options: whatever is a field of it is asked for everywhere."""

import inspect
import json
import tomllib
from dataclasses import fields
from typing import Any

import pytest

import pipeline
from pipeline.errors import RequestError
from pipeline.scenario.catalogue import names
from pipeline.serve.app import page_files
from pipeline.serve.plans import ASKED, PlanRequest
from pipeline.voyage.request import UnderWayRequest, VoyageRequest
from pipeline.voyage.table import Option, help_text, options, spelling
from tests.conftest import ROOT
from tests.reference import commands, options as typed_options

FIELDS = options(VoyageRequest)
NAMED = [one for one in FIELDS if one.group]


def test_every_field_is_described_and_nothing_else() -> None:
    described = tomllib.loads((ROOT / "pipeline/voyage/options.toml").read_text("utf-8"))
    for table in (VoyageRequest, UnderWayRequest):
        assert [*described.pop(table.__name__)] == [one.name for one in fields(table)]
    assert not described


@pytest.mark.parametrize("one", NAMED, ids=[one.field for one in NAMED])
def test_the_command_line_has_every_option_with_its_help(one: Option) -> None:
    typed = typed_options(commands()["renew go"])[one.typed]
    assert typed.help == help_text(one, spelling(VoyageRequest, "command"))
    assert typed.multiple == bool(one.most)


@pytest.mark.parametrize("one", ASKED, ids=[one.field for one in ASKED])
def test_the_page_and_its_interface_have_every_option_of_a_voyage(one: Option) -> None:
    schema = PlanRequest.model_json_schema()
    said = schema["properties"][one.key]["description"]
    assert said == help_text(one, spelling(VoyageRequest, "page"))
    interface: dict[str, Any] = {
        "info": {"description": ""}, "paths": {},
        "components": {"schemas": {"PlanRequest": schema}},
    }  # fmt: skip
    form = page_files(interface)["/"].decode()
    own = {"currents": 'data-file="currents"', "via": 'id="vias"'}
    asked = f'data-{"file" if one.kind == "file" else "option"}="{one.key}"'
    assert own.get(one.key, asked) in form


def test_python_has_every_option_and_says_what_it_does() -> None:
    arguments = set(inspect.signature(pipeline.go).parameters) - {"on_event"}
    assert {one.field for one in FIELDS} == arguments
    text = " ".join(str(pipeline.go.__doc__).split())
    for one in FIELDS:
        assert help_text(one, spelling(VoyageRequest, "python")) in text


def described() -> list[dict[str, Any]]:
    """The options of a voyage as JSON, for QGIS, whose Python can't import the table."""
    at = spelling(VoyageRequest, "page")
    of_a_check = typed_options(commands()["renew check-route"])
    return [
        {
            "name": option.key,
            "option": option.typed if option.group else "",
            "kind": option.kind,
            "label": option.title,
            "help": help_text(option, at),
            "several": bool(option.most),
            "layer": option.layer,
            **({"choices": list(names("vessels"))} if option.section == "vessels" else {}),
            **({} if option.typed in of_a_check else {"only_plans": True}),
        }
        for option in FIELDS
        if not option.is_of_run
    ]


def test_the_list_for_qgis_is_that_of_the_table() -> None:
    """Made by `python -m tests.pipeline.voyage.test_table`."""
    assert json.loads(QGIS.read_text("utf-8")) == described()


def test_faults_name_an_option_as_the_asker_does() -> None:
    with pytest.raises(RequestError) as caught:
        pipeline.go(
            "35N 40W", "35N 39W", speed="12", length="9m", turning_circle="9m", months=("July",),
            endurance="2d", clearance_m=-1.0,
        )  # fmt: skip
    starts = [fault.split()[0] for fault in caught.value.faults]
    assert starts == ["speed", "months", "clearance_m", "endurance"]
    assert not any("--" in fault for fault in caught.value.faults)


QGIS = ROOT / "qgis" / "renew_routes" / "options.json"

if __name__ == "__main__":
    lines = ",\n".join(json.dumps(option, ensure_ascii=False) for option in described())
    QGIS.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
