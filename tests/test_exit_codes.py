"""Exit codes: one table, one line for whatever goes wrong, output that never fails for its own sake."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cls_bench.cli import main
from cls_bench.cli.commands import group
from cls_bench.errors import LONGEST_LINE, BenchError, ControllerError, ExitCode, Interrupted, OutputError, one_line

DOCS = Path(__file__).parent.parent / "docs"


def test_the_docs_have_the_table():
    rows = re.findall(r"^\| (\d+) \| (.+?) \| (.+?) \|$", (DOCS / "exit_codes.md").read_text(), re.MULTILINE)
    assert rows == [(str(int(code)), code.title, code.meaning) for code in ExitCode]


def test_help_has_the_codes():
    told = " ".join(CliRunner().invoke(main, ["--help"]).output.split())
    assert all(f"{code:d} {code.title}" in told for code in ExitCode)


# --- one line ---------------------------------------------------------------------------------------------------------


class NoTextError(Exception):
    def __str__(self):
        raise RuntimeError("no text")

    __repr__ = __str__


class OddText(str):
    def __getitem__(self, key):
        raise RuntimeError

    def split(self, *_):
        raise RuntimeError


class OddTextError(Exception):
    def __str__(self):
        return OddText("odd\ntext")


@pytest.mark.parametrize(("error", "line"), [
    (ValueError("first\n  second\tthird"), "ValueError: first second third"),
    (ValueError(), "ValueError"),
    (ValueError("\x1b[31mred\x07 \u202e"), "ValueError: [31mred"),
    (BenchError("as it is"), "as it is"),
    (NoTextError(), "NoTextError: its text cannot be made"),
    (OddTextError(), "OddTextError: odd text"),
    (ValueError("\udcff"), "ValueError"),
    ("a text", "a text"),
])  # fmt: skip
def test_any_error_is_one_printable_line(error, line):
    assert one_line(error) == line


def test_a_long_text_is_cut():
    assert len(one_line(ValueError("long " * 10**6))) == LONGEST_LINE


RAISED = [
    (BenchError("bad"), 2, "error: bad"),
    (OutputError("full"), 2, "error: full"),
    (ControllerError("mine"), 5, "error: mine"),
    (FileNotFoundError(2, "No such file or directory", "a/b"), 2, "error: a/b: No such file or directory"),
    (OSError(28, "No space left on device"), 2, "error: No space left on device"),
    (KeyboardInterrupt(), 130, "interrupted"),
    (Interrupted("interrupted at t = 1 s; kept: x"), 130, "interrupted at t = 1 s; kept: x"),
    *(
        (error, 70, f"error: internal error: {one_line(error)}; run again with --debug for the traceback")
        for error in (
            MemoryError(), RecursionError("deep"), SystemExit(0), GeneratorExit(), NoTextError(), OSError("odd"),
            BaseExceptionGroup("several", [ValueError("a\nb"), SystemExit(0)]), KeyError("a\nb"),
            UnicodeEncodeError("ascii", "°", 0, 1, "no"), AssertionError(), StopIteration(),
        )
    ),
]  # fmt: skip


@pytest.mark.parametrize(("error", "code", "line"), RAISED, ids=lambda value: type(value).__name__)
def test_whatever_a_command_raises_is_one_line_and_a_code(monkeypatch, error, code, line):
    def fail(**options):
        raise error

    monkeypatch.setattr(group.commands["schema"], "callback", fail)
    result = CliRunner().invoke(main, ["schema"])
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr == line + "\n"
    for arguments, environment in (
        (["--debug", "schema"], {}), (["schema", "--debug"], {}), (["schema"], {"CLS_BENCH_DEBUG": "1"}),
    ):  # fmt: skip
        shown = CliRunner().invoke(main, arguments, env=environment)
        assert shown.exit_code == code
        assert shown.stderr.endswith(line + "\n")
        assert "Traceback" in shown.stderr


@pytest.mark.parametrize("arguments", [["nope"], ["run"], ["run", "--seed", "x", "y"], ["check", "onset", "--nope"],
                                       ["render", "x", "--at", "nan"], ["run", "x", "--seed", str(2**63)]])  # fmt: skip
def test_a_mistake_in_the_arguments_is_one_line(arguments):
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert "--help" in result.stderr


def test_every_number_refuses_nan_and_infinity():
    def options(command):
        yield from ((command, parameter) for parameter in command.params)
        for inner in getattr(command, "commands", {}).values():
            yield from options(inner)

    found = 0
    for command, parameter in options(group):
        kinds = parameter.type.types if isinstance(parameter.type, click.Tuple) else [parameter.type]
        for kind in kinds:
            if isinstance(kind, (click.FloatRange, type(click.FLOAT))):
                for bad in ("nan", "inf", "-inf"):
                    with pytest.raises(click.BadParameter):
                        kind.convert(bad, parameter, click.Context(command))
                found += 1
    assert found > 15


# --- standard streams -------------------------------------------------------------------------------------------------

CLI = f"{sys.executable} -m cls_bench"


def shell(line: str, **environment: str) -> "subprocess.CompletedProcess[bytes]":
    environment = {**os.environ, **environment}
    return subprocess.run(["bash", "-c", line], check=False, capture_output=True, env=environment, timeout=120)


def test_a_reader_that_has_gone_changes_nothing():
    done = shell(f"{CLI} list --parameters | head -1; echo ${{PIPESTATUS[0]}}")
    assert done.stdout.splitlines()[-1] == b"0"
    assert done.stderr == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_device_is_one_line():
    done = shell(f"{CLI} list --signals > /dev/full")
    assert done.returncode == 2
    assert done.stderr == b"error: cannot write standard output: No space left on device\n"
    assert shell(f"{CLI} nope 2> /dev/full").returncode == 2


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_streams_are_no_failure(closed):
    assert shell(f"{CLI} list {closed}").returncode == 0
    assert shell(f"{CLI} nope {closed}").returncode == 2


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437", "utf-8"])
def test_any_code_page_will_do(encoding):
    done = shell(f"{CLI} list --parameters", PYTHONIOENCODING=encoding, LC_ALL="C", PYTHONUTF8="0")
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode(encoding)
    assert ("N·m" if encoding != "ascii" else "N.m") in text
    assert json.loads(shell(f"{CLI} schema", PYTHONIOENCODING=encoding).stdout.decode(encoding))["title"] == "Scenario"


def test_odd_terminals_are_no_failure():
    done = shell(f"{CLI} list", COLUMNS="1", TERM="dumb", NO_COLOR="1")
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_folder_that_is_gone_is_one_line(tmp_path):
    (tmp_path / "s.toml").write_text('title = "s"\nduration = 0.1\n')
    (tmp_path / "gone").mkdir()
    done = shell(f"cd {tmp_path}/gone && rmdir ../gone && {CLI} run ../s.toml")
    assert done.returncode == 2
    assert done.stderr.startswith(b"error: ")
    assert done.stderr.count(b"\n") == 1
