"""The container image, built and run where a builder of images is."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator

import pytest

from tests.conftest import ROOT

TAG = "localhost/renew-test"
CONTAINER = "renew-test"
# What builders say where the registry of the base image can't be reached.
UNREACHABLE = ("pinging container registry", "no such host", "failed to resolve source metadata")


def _done(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def _built(*command: str) -> None:
    """Build the image, or skip the test where its base can't be fetched."""
    done = _done(*command, "--file", "catalog/operation/Containerfile", "--tag", TAG, ".")
    if done.returncode and any(words in done.stderr for words in UNREACHABLE):
        pytest.skip("the registry of the base image can't be reached")
    assert done.returncode == 0, done.stderr[-4000:]


@pytest.fixture(scope="module")
def inside() -> Iterator[tuple[str, ...]]:
    """Build the image; give the beginning of a command that runs `renew` in it."""
    if shutil.which("buildah"):
        # Without namespaces and control groups of its own, which a machine may not allow.
        alone = ("--isolation", "chroot", "--network", "host")
        _built("buildah", "build", *alone, "--layers", "--pull=false")
        assert _done("buildah", "from", "--name", CONTAINER, TAG).returncode == 0
        yield ("buildah", "run", *alone, CONTAINER, "--", "renew")
        _done("buildah", "rm", CONTAINER)
        return
    for program in ("docker", "podman"):
        if shutil.which(program) and _done(program, "info").returncode == 0:
            _built(program, "build")
            yield (program, "run", "--rm", "--read-only", "--tmpfs", "/tmp", TAG)  # noqa: S108 - inside
            return
    pytest.skip("needs buildah, docker or podman")


@pytest.mark.slow
def test_the_image_plans_with_its_own_machine_code(inside: tuple[str, ...]) -> None:
    """As the user of the image, who may write into /data alone."""
    assert _done(*inside, "--version").stdout.startswith("renew 0.")
    done = _done(*inside, "run", "single-gyre", "--offline", "--output", "/data/outputs")
    assert done.returncode == 0, done.stderr[-4000:]
    assert "Written to" in done.stdout
    assert "machine code is cached in a temporary folder" not in done.stderr
