"""The public names: their type hints can be evaluated, and each has documentation."""

from __future__ import annotations

import inspect
import typing

import pytest

import renew

PUBLIC = [getattr(renew, name) for name in renew.__all__]


def callables(public: object) -> list[object]:
    """A function, or a class with its public methods and properties."""
    if not inspect.isclass(public):
        return [public]
    members = [
        member.fget if isinstance(member, property) else getattr(member, "func", member)
        for name, member in vars(public).items()
        if not name.startswith("_")
    ]
    return [public, *(member for member in members if inspect.isfunction(member))]


@pytest.mark.parametrize("public", PUBLIC, ids=renew.__all__)
def test_type_hints_can_be_evaluated(public: object) -> None:
    for one in callables(public):
        typing.get_type_hints(one)


@pytest.mark.parametrize("public", PUBLIC, ids=renew.__all__)
def test_everything_public_is_documented(public: object) -> None:
    for one in callables(public):
        assert inspect.getdoc(one), one
