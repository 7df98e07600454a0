"""The options of a voyage, and how they are typed; nothing here needs QGIS."""

import json
from pathlib import Path

DEFAULT_VESSEL = "usv-7m"
# Options that describe a vessel in place of its name.
_FIGURES = ("speed", "length", "turning_circle", "draught")


def voyage_options():
    """Read the options of a voyage, which `renew` made from its own table."""
    return json.loads(Path(__file__).with_name("options.json").read_text("utf-8"))


def typed(options, texts):
    """Return options of a voyage as they are typed, positions first; `texts` are values by name.

    The vessel that QGIS offers is left out if any figure of another vessel is given. A range of
    speeds, such as 4kn..9kn, is no figure of a vessel: the planner chooses from it.
    """
    figures = [texts.get(name, "") for name in _FIGURES]
    if texts.get("vessel") == DEFAULT_VESSEL and any(
        figure and ".." not in figure for figure in figures
    ):
        texts = {**texts, "vessel": ""}
    command, places = [], []
    for option in options:
        text = texts[option["name"]]
        if option["kind"] == "place":
            places.append(text)
        elif option["kind"] == "flag":
            command += [option["option"]] if text else []
        else:
            values = text.split(";") if option["several"] else [text]
            given = [value.strip() for value in values if value.strip()]
            command += [word for value in given for word in (option["option"], value)]
    return [*places, *command]
