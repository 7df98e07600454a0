"""A subprocess with a deadline."""

from __future__ import annotations

import time
from pathlib import Path

from pipeline.machine.interpreters import run_python
from tests.pipeline.processes import ends_within


def test_a_process_that_hangs_is_killed_with_its_children_at_the_deadline(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    script = (
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(pid_file)!r}, 'w').write(str(child.pid))\n"
        "sys.stderr.write('the last message')\n"
        "sys.stderr.flush()\n"
        "time.sleep(60)\n"
    )
    begun = time.monotonic()
    result = run_python(["-c", script], "", 1.5)
    assert (result.exit_code, result.stderr) == (None, "the last message")
    assert 1.4 < time.monotonic() - begun < 10
    assert ends_within(int(pid_file.read_text()), seconds=5), "its child process still runs"


def test_input_exit_code_and_output_are_passed_through() -> None:
    script = "import sys; text = sys.stdin.read(); sys.stderr.write(text * 2); print(text)"
    result = run_python(["-c", script + "; sys.exit(3)"], "ab", 30)
    assert (result.exit_code, result.stdout, result.stderr) == (3, "ab\n", "abab")


def test_an_input_larger_than_a_pipe_reaches_a_process_that_starts_slowly() -> None:
    """Paths of thousands of files: a process that waited for the rest hung until its deadline."""
    lines = "\n".join(f"/a/path/of/some/length/{i:08}.nc" for i in range(20_000))
    code = "import sys, time; time.sleep(0.3); print(len(sys.stdin.read()))"
    result = run_python(["-c", code], lines, 30.0)
    assert (result.exit_code, result.stdout.strip()) == (0, str(len(lines)))


def test_a_process_that_reads_no_input_ends() -> None:
    result = run_python(["-c", "print(1)"], "x" * 10_000_000, 30.0)
    assert (result.exit_code, result.stdout.strip()) == (0, "1")
