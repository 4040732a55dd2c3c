"""Scenario, sweep and override texts that no one would write: refused in one line, at once, with little memory."""

import random
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from cls_bench.errors import InputError
from cls_bench.experiment import validate
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import parse_scenario
from cls_bench.sweep.plan import load_sweep

HEAD = 'title = "t"\nduration = 1.0\n'
SIZE = 64_000


def repeated(text: str, size: int = SIZE) -> str:
    return text * (size // len(text))


TEXTS: dict[str, Callable[[], str]] = {
    "dotted key": lambda: HEAD + repeated("a.") + "a = 1\n",
    "dotted key with blanks": lambda: HEAD + repeated("a . ") + "a = 1\n",
    "dotted key of quotes": lambda: HEAD + repeated('"a".') + "a = 1\n",
    "dotted key in a table": lambda: HEAD + "x = {" + repeated("a.") + "a = 1}\n",
    "dotted header": lambda: HEAD + "[" + repeated("a.") + "a]\n",
    "dotted header of tables": lambda: HEAD + "[[" + repeated("a.") + "a]]\n",
    "dotted parameter": lambda: HEAD + "[parameters]\n" + repeated("feel.") + "a = 1\n",
    "many dotted keys": lambda: HEAD + "".join(f"{'a.' * 9}k{n} = 1\n" for n in range(2500)),
    "many headers": lambda: HEAD + "".join(f"[a{n}]\n" for n in range(8000)),
    "nested arrays": lambda: HEAD + "x = " + "[" * 30_000 + "]" * 30_000,
    "open arrays": lambda: HEAD + "x = " + "[" * 60_000,
    "nested tables": lambda: HEAD + "x = " + repeated("{a=", 30_000) + "1" + "}" * 10_000,
    "nested in parameters": lambda: HEAD + "[parameters]\nfeel = " + "{a=" * 200 + "1" + "}" * 200,
    "4300 digits": lambda: HEAD.replace("1.0", "1" * 4300),
    "4301 digits": lambda: HEAD.replace("1.0", "1" * 4301),
    "60 000 digits": lambda: HEAD + "seed = " + "9" * 60_000,
    "hexadecimal": lambda: HEAD + "seed = 0x" + "f" * 60_000,
    "digits with underscores": lambda: HEAD + "seed = " + "9_" * 30_000 + "9",
    "a parameter of many digits": lambda: HEAD + f"[parameters]\nfeel.inertia = {'9' * 190}\n",
    "an array of digits": lambda: HEAD + f"hand = [{','.join(['9' * 190] * 300)}]",
    "digits in a check": lambda: HEAD
    + f'checks = [{{name = "a", metric = "mean", window = [0, 1], max = {"9" * 190}}}]',
    "checks": lambda: HEAD + '[[checks]]\nname="a"\n' * 3000,
    "10 000 checks": lambda: HEAD + "[[checks]]\n" * 5500,
    "good checks": lambda: HEAD
    + "".join(f'[[checks]]\nname="{n}"\nmetric="tracking_lag_ms"\nwindow=[0,1]\n' for n in range(1100)),
    "hands": lambda: HEAD + "".join(f'[[hand]]\nat={n}e-9\nkind="hold"\n' for n in range(2000)),
    "bad hands": lambda: HEAD + "hand = [" + "1," * 30_000 + "]",
    "changes": lambda: HEAD
    + "".join(f"[[changes]]\nat={(n + 1) * 2e-4:.4f}\nparameters.limb.mass=1.{n:04d}\n" for n in range(1200)),
    "unknown keys": lambda: HEAD + "".join(f"k{n}=1\n" for n in range(7000)),
    "unknown parameters": lambda: HEAD + "[parameters]\n" + "".join(f"k{n}=1\n" for n in range(7000)),
    "a long key": lambda: HEAD + "k" * 60_000 + " = 1\n",
    "a long quoted key": lambda: HEAD + '"' + "k" * 60_000 + '" = 1\n',
    "a long title": lambda: f'title = "{"x" * 60_000}"\nduration = 1.0\n',
    "a long metric": lambda: HEAD + f'checks = [{{name = "a", metric = "{"m" * 60_000}", window = [0, 1]}}]',
    "a long signal": lambda: HEAD
    + f'checks = [{{name = "a", metric = "mean", signal = "{"m" * 60_000}", window = [0, 1]}}]',
    "a long kind": lambda: HEAD + f'hand = [{{at = 0.0, kind = "{"m" * 60_000}"}}]',
    "a long file": lambda: HEAD + f'hand = [{{at = 0.0, kind = "samples", unit = "N", file = "{"m" * 190}"}}]',
    "a huge array": lambda: HEAD + "x = [" + "1," * 30_000 + "]",
    "a huge window": lambda: HEAD
    + f'checks = [{{name = "a", metric = "mean", signal = "/column.angle", window = [{"1," * 30_000}]}}]',
    "many arguments": lambda: HEAD + 'checks = [{name = "a", metric = "mean", signal = "/column.angle", '
    "window = [0, 1], arguments = {" + ",".join(f"a{n} = 1" for n in range(5000)) + "}}]",
    "quotes and backslashes": lambda: HEAD + "x = " + repeated('\\"'),
    "quotes": lambda: HEAD + "x = " + repeated('"'),
    "apostrophes": lambda: HEAD + "x = " + repeated("'"),
    "an open text": lambda: HEAD + 'x = """' + repeated('\\"'),
    "escapes": lambda: HEAD + 'x = "' + repeated("\\u0041") + '"',
    "comments": lambda: HEAD + repeated("#") + "\nx = 1",
    "blank lines": lambda: HEAD + "\n" * 60_000 + "x = 1",
    "control characters in a key": lambda: HEAD + r'"a\nb\u001b[31m\u2028\u0085\u202e" = 1',
    "control characters in a parameter": lambda: HEAD + '[parameters]\n"a\\nb.c" = 1',
    "control characters in a text": lambda: HEAD + r'hand = [{at = 0.0, kind = "x\ny\u001b"}]',
    "control characters in a title": lambda: 'title = "a\\nb"\nduration = 1.0\n',
    "a line in a name": lambda: HEAD + r'checks = [{name = "a\nb", metric = "mean", window = [0, 1]}]',
    "control characters in a file": lambda: HEAD
    + r'hand = [{at = 0.0, kind = "samples", unit = "N", file = "\u0000\n"}]',
    "control characters in a metric": lambda: HEAD + r'checks = [{name = "a", metric = "\n", window = [0, 1]}]',
    "control characters in an argument": lambda: HEAD
    + r'checks = [{name = "a", metric = "ripple", signal = "/column.angle", window = [0, 1], arguments = {"\n" = 1}}]',
    "no date": lambda: HEAD + "x = 2024-13-41T25:61:61Z",
    "a date": lambda: HEAD + "seed = 2024-01-01",
    "no number": lambda: HEAD + "[parameters]\nfeel.inertia = nan",
    "too large a file": lambda: HEAD + "#" * 1_000_001,
    "bytes": lambda: "\ud800 = 1",
}
"""None of them is a scenario."""


@pytest.mark.parametrize("name", TEXTS)
def test_a_hostile_text_is_refused_at_once(name: str) -> None:
    text = TEXTS[name]()
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        validate(parse_scenario(text))
    assert time.process_time() - begun < 1.0
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 1200


def test_hostile_texts_take_little_memory() -> None:
    """All in one process of its own: its peak is that of the greediest."""
    code = (
        "import resource\nfrom tests.test_hostile_scenarios import TEXTS, parse_scenario, InputError, validate\n"
        "texts = [make() for make in TEXTS.values()]\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "for text in texts:\n    try:\n        validate(parse_scenario(text))\n    except InputError:\n        pass\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=Path(__file__).parents[1])  # fmt: skip
    unit = 1024 if sys.platform == "darwin" else 1
    assert int(done.stdout) / unit < 300_000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 0


OVERRIDES: dict[str, str] = {
    "dotted key": "a." * 30_000 + "a=1",
    "long value": "feel.inertia=" + "1" * 60_000,
    "digits": "seed=" + "1" * 5000,
    "hexadecimal": "seed=0x" + "f" * 5000,
    "nested": "seed=" + "[" * 3000 + "]" * 3000,
    "open": "seed=" + "[" * 3000,
    "tables": "parameters.feel=" + "{a=" * 900 + "1" + "}" * 900,
    "index": "hand[" + "1" * 5000 + "].at=1",
    "line in the key": "a\nb\x1b[31m=1",
    "line in the value": "seed=1\nx=2",
    "line in a text": 'plc.outer_loop="""a\nb"""',
    "surrogate": "\udcff=1",
    "surrogate in a value": 'plc.outer_loop="\udcff"',
    "surrogate as a word": "plc.outer_loop=x\udcff",
    "blank": "   ",
}


@pytest.mark.parametrize("name", OVERRIDES)
def test_a_hostile_override_is_refused_at_once(name: str) -> None:
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        parse_scenario(HEAD, set=[OVERRIDES[name]])
    assert time.process_time() - begun < 1.0
    message = str(caught.value)
    assert message.isprintable()
    assert "--set" in message
    assert len(message) < 600


SWEEP = 'title = "s"\nscenario = "friction_masking"\n'
SWEEPS: dict[str, tuple[str, str]] = {
    "range": ('axes = [{key = "feel.inertia", kind = "range", from = 0.1, to = 1.0, count = 1000000000}]', "count"),
    "log_range": ('axes = [{key = "feel.inertia", kind = "log_range", from = 0.1, to = 1.0, count = 10000000}]',
                  "count"),
    "product": ("".join(f'[[axes]]\nkey = "feel.{key}"\nkind = "range"\nfrom = 0.1\nto = 1.0\ncount = 1000000\n'
                        for key in ("inertia", "damping")), "1000000000000 points are more than"),
    "samples": ('samples = 1000000000\naxes = [{key = "feel.inertia", kind = "uniform", from = 0.1, to = 1.0}]',
                "samples"),
    "axes": ("".join(f'[[axes]]\nkey = "a{n}"\nkind = "list"\nvalues = [1]\n' for n in range(1000)), "entries"),
    "number": ('axes = [{key = "feel.inertia", kind = "uniform", from = 1e-300, to = 1e300}]', "axes[0].to"),
    "digits": (f'seed = {"9" * 5000}\naxes = []', "line 3: a key or number of 5000 characters"),
    "dots": ("a." * 30_000 + "a = 1", "line 3: a key of more than 10 parts"),
    "brackets": ("axes = " + "[" * 30_000, "line 3: more than 10 brackets"),
    "broken": ("axes = ", "line 3, column 8: broken TOML"),
    "key": ('"a\\nb" = 1', "a\\nb: unknown key"),
    "value": (f'axes = "{"x" * 60_000}"', "axes: "),
}


@pytest.mark.parametrize("name", SWEEPS)
def test_a_hostile_sweep_is_refused_at_once(tmp_path: Path, name: str) -> None:
    text, said = SWEEPS[name]
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP + text)
    begun = time.process_time()
    with pytest.raises(InputError) as caught:
        load_sweep(path)
    assert time.process_time() - begun < 1.0
    message = str(caught.value)
    assert message.isprintable()
    assert said in message
    assert len(message) < 1200


# --- mutations -------------------------------------------------------------------------------------------------------

BITS = ("", "[", "]", "{", "}", "=", '"', "'", ".", ",", "\n", "#", "-", "0", "1e9", "1e308", "nan", "inf", "-inf",
        "\\", "[[hand]]", "[[checks]]", "kind", "true", "é", "\x00", "\x1b", "\u2028", "99999999999999999999", "0x",
        "2024-01-01", '"""', "'''", "1e-300", "hold", "samples", "file", "value", "arguments", "at_deg", "60", "-60",
        "2000")  # fmt: skip


def mutated(text: str, rng: random.Random) -> str:
    """``text`` with some of its characters, words, lines or numbers changed, left out, doubled or exchanged."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        kind, at = rng.randrange(7), rng.randrange(len(text) + 1)
        end = min(len(text), at + rng.choice((1, 1, 2, 5, 20)))
        if kind == 0:
            text = text[:at] + rng.choice(BITS) + text[at:]
        elif kind == 1:
            text = text[:at] + text[end:]
        elif kind == 2:
            text = text[:at] + rng.choice(BITS) + text[end:]
        elif kind == 3:
            lines = text.split("\n")
            one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[one], lines[other] = lines[other], lines[one]
            text = "\n".join(lines)
        elif kind == 4:
            lines = text.split("\n")
            lines.insert(rng.randrange(len(lines)), rng.choice(lines))
            text = "\n".join(lines)
        elif kind == 5:
            text = text[:at] + chr(rng.choice((rng.randrange(0x80), rng.randrange(0xD800)))) + text[end:]
        else:  # a number becomes another
            places = [k for k, letter in enumerate(text) if letter.isdigit()]
            if places:
                at = rng.choice(places)
                text = text[:at] + rng.choice(("-", "1e", "9999999", "0.", "0", str(rng.random()))) + text[at + 1 :]
    return text


def fuzz(count: int, seed: int) -> dict[str, int]:
    """Outcomes of ``count`` mutated scenarios; AssertionError at the first that is neither valid nor one line."""
    rng = random.Random(seed)
    sources = [path.read_text(encoding="utf-8") for path in shipped_scenarios().values()]
    tally = {"valid": 0, "refused": 0}
    for number in range(count):
        text = mutated(rng.choice(sources), rng)
        begun = time.process_time()
        try:
            validate(parse_scenario(text, name="fuzz"))
            tally["valid"] += 1
        except InputError as error:
            assert str(error).isprintable(), (number, str(error))
            assert str(error).startswith("fuzz: "), (number, str(error))
            tally["refused"] += 1
        except Exception as error:
            raise AssertionError(f"{number}: {type(error).__name__}: {error}\n{text}") from error
        assert time.process_time() - begun < 1.0, (number, text)
    return tally


def test_a_mutated_scenario_is_valid_or_refused_in_one_line() -> None:
    tally = fuzz(300, seed=1)
    assert tally["valid"] > 30
    assert tally["refused"] > 100


@pytest.mark.slow
def test_many_mutated_scenarios() -> None:
    print(fuzz(10_000, seed=2))
