"""Scenario files that were mutated, and those that are made to cost time and memory."""

import re
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from tests.attacks import reference
from tests.attacks.in_process import call_here, guarded
from tests.attacks.trials import (
    PASSED,
    PROJECT,
    REFUSED,
    Attack,
    LostError,
    Trial,
    forget_peak,
    judge_output,
    memory_mb,
)

MOST_SECONDS = 1.0
"""Processor time for a file of 64 kB."""

MOST_GROWTH_MB = 300.0

SIZE = 64_000

Rng = np.random.Generator

VALUES = (
    "0", "-1", "1", "nan", "-nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e999", "-0.0", "0x7fff", "1_000_000",
    "9223372036854775807", "9223372036854775808", "-9223372036854775809", "9" * 4300, "9" * 5000, "1e5000", "true",
    "false", '""', '"x"', "'''x'''", '"\\u0000"', '"\\ud800"', f'"{"x" * 5000}"', '"on"', '"off"',
    '"hold"', '"feel.inertia"', "[]",
    "{}", "[[]]", "[1, 2]", "[0.0, 1e9]", "[nan, nan]", "[1.0, 0.0]", "{a = 1}", "1979-05-27", "07:32:00",
    "1979-05-27T07:32:00Z", "[" * 200 + "]" * 200, "3600", "3601", "1e-9", "5e-5", "0.3",
    '"/column.angle"', '"../../../etc/passwd"',
    '"/dev/zero"', '"CON"', "0.1", "60", "-60", "61", "2000", "1e-300", "1e300", "3.141592653589793238462643383279",
    "+1", "01", "1.", ".5",
)  # fmt: skip

WORDS = (
    "at", "kind", "title", "duration", "parameters", "hand", "checks", "changes", "squeeze", "window", "metric",
    "signal", "feel", "inertia", "motor", "drive", "limb", "mass", "gearbox", "stage1", "file", "unit", "column",
    "delimiter",
    "decimal", "arguments", "expected_trips", "controller", "record", "seed", "min", "max", "value", "over",
    "\u00e4", "", "a" * 3000,
)  # fmt: skip


@cache
def seeds() -> tuple[str, ...]:
    """Scenarios to begin with."""
    shipped = [path.read_text(encoding="utf-8") for path in sorted((PROJECT / "scenarios").glob("*.toml"))]
    samples = (
        reference.scenario(2.0)
        .replace("amplitude_deg = 4.0", 'file = "hand.csv"')
        .replace("frequency = 1.3", 'unit = "deg"')
    )
    return (
        *shipped,
        reference.SCENARIO,
        re.sub(r'"sine"|fade = 0.5', lambda m: '"samples"' if "sine" in m[0] else "", samples),
    )


def _lines(text: str, rng: Rng, change: Callable[[list[str], int], None]) -> str:
    lines = text.split("\n")
    change(lines, int(rng.integers(len(lines))))
    return "\n".join(lines)


def _value(text: str, rng: Rng) -> str:
    """Another value for a key."""
    found = list(re.finditer(r"=\s*([^\n,}\]]+)", text))
    if not found:
        return text
    place = found[int(rng.integers(len(found)))]
    return text[: place.start(1)] + VALUES[int(rng.integers(len(VALUES)))] + text[place.end(1) :]


def _key(text: str, rng: Rng) -> str:
    """Another name for a key, a table or a part of one."""
    found = list(re.finditer(r"[A-Za-z_][\w]*", text))
    place = found[int(rng.integers(len(found)))]
    return text[: place.start()] + WORDS[int(rng.integers(len(WORDS)))] + text[place.end() :]


def _number(text: str, rng: Rng) -> str:
    """A number that is not far from what it was, or very far."""
    found = list(re.finditer(r"-?\d+\.?\d*", text))
    if not found:
        return text
    place = found[int(rng.integers(len(found)))]
    factor = float(rng.choice([-1.0, 0.0, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, 1e6, 1e-6, 1e300]))
    return text[: place.start()] + repr(float(place[0]) * factor) + text[place.end() :]


def _parameter(text: str, rng: Rng) -> str:
    """A parameter with a value that may or may not be one."""
    from cls_bench.parameters import Parameters, leaves

    known = list(leaves(Parameters()))
    key, value, _ = known[int(rng.integers(len(known)))]
    number = isinstance(value, float)
    new = (
        repr(value * float(rng.choice([0.01, 0.1, 0.5, 2.0, 10.0, 1e4])))
        if number and rng.random() < 0.6
        else str(rng.choice(VALUES))
    )
    return f"parameters.{key} = {new}\n{text}"


def _bytes(text: str, rng: Rng) -> str:
    data = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 8))):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    return data.decode("latin-1")


def _copy(lines: list[str], k: int) -> None:
    lines.insert(k, lines[k])


def _delete(lines: list[str], k: int) -> None:
    del lines[k]


MUTATIONS: tuple[Callable[[str, Rng], str], ...] = (
    _value, _value, _value, _key, _key, _number, _number, _parameter, _parameter, _bytes,
    lambda text, rng: _lines(text, rng, _copy),
    lambda text, rng: _lines(text, rng, _delete),
    lambda text, rng: text[: int(rng.integers(len(text)))],
    lambda text, rng: text.replace("[[", "[").replace("]]", "]") if rng.random() < 0.5 else text.replace("=", ":", 3),
    lambda text, rng: text + text,
    lambda text, rng: text.replace("\n", "\r\n") if rng.random() < 0.5 else "\ufeff" + text,
)  # fmt: skip


def _filled(text: str, part: str) -> str:
    """``text`` with as many of ``part`` as 64 kB hold."""
    return text + part * ((SIZE - len(text)) // len(part))


def _numbered(text: str, part: str) -> str:
    parts, size, k = [text], len(text), 0
    while size + len(part) + 5 < SIZE:
        parts.append(part.replace("#", str(k)))
        size += len(parts[-1])
        k += 1
    return "".join(parts)


@cache
def extremes() -> tuple[tuple[str, bytes], ...]:
    """Name and content of files that are made to cost time and memory."""
    head = 'title = "x"\nduration = 1.0\n'
    check = '[[checks]]\nname = "c#"\nmetric = "maximum"\nsignal = "/column.angle"\nwindow = [0.0, 1.0]\n'
    texts = {
        "a key of 20 000 parts": head + "a." * 20_000 + "b = 1",
        "a key of 20 000 quoted parts": head + '"a".' * 15_000 + "b = 1",
        "a table of 20 000 parts": head + "[" + "a." * 20_000 + "b]\nx = 1",
        "a parameter of 20 000 parts": head + "[parameters]\n" + "a." * 20_000 + "b = 1",
        "a quoted parameter of 20 000 parts": head + '[parameters]\n"' + "a." * 20_000 + 'b" = 1',
        "a live parameter of 20 000 parts": head
        + '[[changes]]\nat = 0.1\n[changes.parameters]\n"'
        + "a." * 20_000
        + 'b" = 1',
        "many keys of 100 parts": _numbered(head, "a." * 100 + "b# = 1\n"),
        "many tables of 100 parts": _numbered(head, "[" + "a." * 100 + "b#]\n"),
        "many tables within tables": _numbered(head, "[a#." + "b." * 30 + "c]\nx.y.z = 1\n"),
        "arrays 30 000 deep": head + "x = " + "[" * 30_000 + "]" * 30_000,
        "arrays 900 deep": head + "x = " + "[" * 900 + "]" * 900,
        "tables 10 000 deep": head + "x = " + "{a=" * 10_000 + "1" + "}" * 10_000,
        "tables 300 deep": head + "x = " + "{a=" * 300 + "1" + "}" * 300,
        "parameters 300 deep": head + "parameters = " + "{a=" * 300 + "1" + "}" * 300,
        "an integer of 4 300 digits": head + "seed = " + "9" * 4300,
        "an integer of 4 301 digits": head + "seed = " + "9" * 4301,
        "an integer of 60 000 digits": head + "seed = " + "9" * 60_000,
        "a hexadecimal integer of 60 000 digits": head + "seed = 0x" + "f" * 60_000,
        "a float of 60 000 digits": head + "x = 1." + "9" * 60_000,
        "a duration of 4 300 digits": 'title = "x"\nduration = ' + "9" * 4300,
        "an array of integers of 4 300 digits": head + "x = [" + ("9" * 4299 + ", ") * 14 + "]",
        "10 000 checks": head + "checks = [" + "{}," * 10_000 + "]",
        "as many checks as fit": _numbered(head, check),
        "as many equal checks as fit": _filled(head, check.replace("#", "")),
        "as many segments as fit": _numbered(head, '[[hand]]\nat = 0.#\nkind = "hold"\nangle_deg = 1\n'),
        "as many empty segments as fit": _filled(head, "[[hand]]\n"),
        "as many changes as fit": _numbered(head, '[[changes]]\nat = 0.#\nparameters = {"feel.inertia" = 0.3}\n'),
        "as many squeezes as fit": _numbered(head, "[[squeeze]]\nat = 0.#\nvalue = 0.5\n"),
        "as many unknown keys as fit": _numbered(head, "k# = 1\n"),
        "as many unknown parameters as fit": _numbered(head + "[parameters]\n", "feel.x# = 1\n"),
        "as many quoted parameters as fit": _numbered(head + "[parameters]\n", '"feel.x#" = 1\n'),
        "as many unknown live parameters as fit": _numbered(
            head + "[[changes]]\nat = 0.1\n[changes.parameters]\n", '"feel.x#" = 1\n'
        ),
        "as many arguments of a check as fit": _numbered(head + check + "[checks.arguments]\n", "a# = 1\n"),
        "as many empty arrays as fit": head + "hand = [" + "[]," * 20_000 + "]",
        "as many numbers as fit": head + "hand = [" + "1," * 30_000 + "]",
        "a name of 60 000 letters": head + f'[[checks]]\nname = "{"x" * 60_000}"',
        "a title of 60 000 letters": f'title = "{"x" * 60_000}"\nduration = -1.0\n',
        "a title of 60 000 line ends": f'title = """{chr(10) * 60_000}"""\nduration = -1.0\n',
        "60 000 escapes": 'title = "' + "\\u00e4" * 10_000 + '"\nduration = -1.0\n',
        "60 000 quotes": head + '"' * 60_000,
        "60 000 apostrophes": head + "'" * 60_000,
        "60 000 opening brackets": "[" * 60_000,
        "60 000 dots": "a" + "." * 60_000,
        "60 000 equal signs": "a" + "=" * 60_000,
        "60 000 blanks": " " * 60_000,
        "60 000 line ends": "\n" * 60_000,
        "60 000 tabs and a key": "\t" * 60_000 + "x",
        "60 000 carriage returns": "\r" * 60_000,
        "60 000 comments": "#\n" * 30_000,
        "60 000 commas": head + "x = [" + "," * 60_000,
        "a signal of 60 000 letters": head + check.replace("/column.angle", "/" + "x" * 60_000),
        "a metric of 60 000 letters": head + check.replace('"maximum"', '"' + "maximu" * 10_000 + '"'),
        "a parameter of 60 000 letters": head + "[parameters]\n" + "inerti" * 10_000 + " = 1",
        "a kind of 60 000 letters": head + '[[hand]]\nat = 0\nkind = "' + "hol" * 20_000 + '"',
        "a file name of 60 000 letters": head
        + '[[hand]]\nat=0\nkind="samples"\nunit="deg"\nfile="'
        + "x" * 60_000
        + '"',
        "a file name with a zero byte": head + '[[hand]]\nat=0\nkind="samples"\nunit="deg"\nfile="a\\u0000b"',
        "a file that is a folder": head + '[[hand]]\nat=0\nkind="samples"\nunit="deg"\nfile="."',
        "dates": _numbered(head, "d# = 1979-05-27T00:32:00.999999-07:00\n"),
        "dates that are none": head + "x = 9999-99-99T99:99:99",
        "a check of an hour": 'title = "x"\nduration = 3600.0\n' + check.replace("1.0]", "3600.0]"),
    }
    contents = {name: text.encode() for name, text in texts.items()}
    rng = np.random.default_rng(0)
    contents |= {
        "noise": rng.bytes(SIZE), "zeros": bytes(SIZE), "UTF-16": (head * 500).encode("utf-16"),
        "Latin-1": b'title = "\xe4"',
        "surrogates": b'title = "\xed\xa0\x80"', "nothing": b"", "a byte order mark": b"\xef\xbb\xbf" + head.encode(),
    }  # fmt: skip
    return tuple((name, content[:SIZE] if name == "noise" else content) for name, content in contents.items())


def prepare(stage: Path) -> None:
    from cls_bench.bench import Bench
    from cls_bench.parameters import Parameters

    Bench(Parameters()).compile()  # once, outside of the trials
    (stage / "hand.csv").write_text("time,value\n0,0\n0.5,2\n1,0\n")


def validate(trial: Trial) -> str:
    """Validate a scenario file: it is valid or refused in one line, in less than 1 s and 300 MB."""
    from cls_bench import experiment, scenario  # noqa: F401  (not counted)

    files = extremes()
    path = trial.folder / "input" / "mutated.toml"
    path.parent.mkdir()
    (path.parent / "hand.csv").write_bytes((trial.stage / "hand.csv").read_bytes())
    if trial.number < len(files):
        what, content = files[trial.number]
    else:
        what, content = _mutated(trial.rng)
    path.write_bytes(content)
    try:
        with guarded(trial.folder):
            before = memory_mb(what="VmRSS")
            forget_peak()
            start = time.process_time()
            code, text, errors = call_here("validate", path, folder=trial.folder)
            seconds, grown = time.process_time() - start, memory_mb() - before
        judge_output(code, text, errors, {PASSED, REFUSED})
        if code == REFUSED and str(path) not in errors:
            raise LostError(f"the error does not name the file: {errors[:200]}")
        if seconds > MOST_SECONDS:
            raise LostError(f"takes {seconds:.1f} s")
        if grown > MOST_GROWTH_MB:
            raise LostError(f"takes {grown:.0f} MB")
        if code == PASSED and trial.number % 5 == 0:
            _begin(path)
    except LostError as error:
        raise LostError(f"{what}: {error}") from None
    return f"{what}: {'valid' if code == PASSED else 'refused'}"


def _mutated(rng: Rng) -> tuple[str, bytes]:
    text = seeds()[int(rng.integers(len(seeds())))]
    for _ in range(int(rng.integers(1, 4))):
        mutation = MUTATIONS[int(rng.integers(len(MUTATIONS)))]
        text = mutation(text, rng) or "x"
    return "mutated", text.encode("utf-8", "surrogatepass")[:SIZE]


def _begin(path: Path) -> None:
    """What is valid can be run: its first 0.2 s end without an error, or with one that is said."""
    from cls_bench.bench import Bench
    from cls_bench.drivers import scripted
    from cls_bench.errors import BenchError
    from cls_bench.scenario import load_scenario

    scenario = load_scenario(path)
    try:
        block = next(scripted.run(Bench(scenario.parameters_at_start(), seed=scenario.seed), scenario))
    except BenchError:
        return
    lost = [topic for topic, rows in block.signals.items() if not np.isfinite(rows).all()]
    if lost and not any(event.level == "error" for event in block.events):
        raise LostError(f"valid, and runs into NaN in {', '.join(lost)} without a word")


SCENARIOS = Attack(
    "scenario",
    "mutated scenario files",
    10_000 + len(extremes()),
    range(len(extremes()) + 250),
    validate,
    prepare,
    60.0,
)
