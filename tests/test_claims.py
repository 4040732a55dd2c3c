"""Names that are claimed: no two writers share one, and nobody sees a file that is half written."""

import os
import stat
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cls_bench.claims import (
    LONGEST_NAME,
    claim_stem,
    claimed_folder,
    claimed_page,
    file_name,
    page_mark,
    replaced,
    write_text,
)
from cls_bench.errors import OutputError

BOTH = (".mcap", ".rrd")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_ten_threads_get_ten_names(tmp_path: Path) -> None:
    with ThreadPoolExecutor(10) as pool:
        stems = list(pool.map(lambda _: claim_stem(tmp_path / "new", "run", BOTH), range(10)))
    assert len(set(stems)) == 10
    expected = ["run", *(f"run-{number}" for number in range(2, 11))]
    assert names(tmp_path / "new") == sorted(stem + suffix for stem in expected for suffix in BOTH)


def test_ten_processes_get_ten_names(tmp_path: Path) -> None:
    script = f"""
from pathlib import Path
from cls_bench.claims import claim_stem
input()
for _ in range(20):
    print(claim_stem(Path({str(tmp_path)!r}), "run", {BOTH!r}))
"""
    command = [sys.executable, "-c", script]
    started = [subprocess.Popen(command, stdin=-1, stdout=-1, text=True) for _ in range(10)]
    for process in started:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    stems = [line for process in started for line in process.communicate()[0].split()]
    assert len(stems) == len(set(stems)) == 200
    assert Counter(path.suffix for path in tmp_path.iterdir()) == {".mcap": 200, ".rrd": 200}


def test_a_file_that_is_left_alone_is_not_taken_over(tmp_path: Path) -> None:
    (tmp_path / "run.rrd").write_text("another's")
    (tmp_path / "run-2.mcap").symlink_to("nowhere")
    assert claim_stem(tmp_path, "run", BOTH) == tmp_path / "run-3"
    assert claim_stem(tmp_path, "run", (".mcap",), (".rrd",)) == tmp_path / "run-4"
    assert (tmp_path / "run.rrd").read_text() == "another's" and not (tmp_path / "run.mcap").exists()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"^cannot write .*/file: File exists$"):
        claim_stem(tmp_path / "file", "run", BOTH)
    with pytest.raises(OutputError, match=r"^cannot write .*/file/a: Not a directory$"):
        claim_stem(tmp_path / "file" / "a", "run", BOTH)


@given(st.text(st.characters(codec="utf-8")) | st.text(min_size=150, max_size=400))
def test_any_text_makes_a_name(text: str) -> None:
    name = file_name(text)
    assert 0 < len(os.fsencode(name)) <= LONGEST_NAME and "/" not in name and name not in (".", "..")
    assert not any(ord(c) < 32 for c in name)
    assert file_name(name) == name


def test_long_names_stay_different_and_short_ones_as_they_are(tmp_path: Path) -> None:
    assert file_name("motion_tracking") == "motion_tracking" and file_name("Prüfstand 2.5") == "Prüfstand 2.5"
    a, b = file_name("ü" * 245 + "a"), file_name("ü" * 245 + "b")
    assert a != b and a.startswith("ü" * 80)
    odd = os.fsdecode(b"scen\xff.x")
    assert claim_stem(tmp_path, odd, BOTH).name == odd


def test_a_file_is_replaced_at_once_or_not_at_all(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("old")
    with pytest.raises(KeyboardInterrupt), replaced(page) as file:
        file.write_text("half")
        assert page.read_text() == "old"
        raise KeyboardInterrupt
    assert names(tmp_path) == ["page.html"] and page.read_text() == "old"
    (tmp_path / "link.html").symlink_to("page.html")
    write_text(tmp_path / "link.html", "new")
    assert page.read_text() == "new" and (tmp_path / "link.html").is_symlink()
    assert names(tmp_path) == ["link.html", "page.html"]


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe")
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(pipe.read_text)
        write_text(pipe, "page")
        assert reading.result(10) == "page"
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_folder_in_use_is_left_for_another(tmp_path: Path) -> None:
    folder, began = tmp_path / "new" / "sweep", time.time()
    time.sleep(0.02)  # the file system's clock is coarse
    with claimed_folder(folder, began) as first, claimed_folder(folder, began) as second:
        assert (first.name, second.name) == ("sweep", "sweep-2")
        with pytest.raises(OutputError, match="sweep is being written by another cls-bench"):
            claimed_folder(folder, began, resume=True).__enter__()
    with claimed_folder(folder, began) as third:  # filled since this command began, though nobody writes there now
        assert third.name == "sweep-3"
    time.sleep(0.02)
    with claimed_folder(folder, time.time()) as later:
        assert later == folder
    with claimed_folder(folder, began, resume=True) as again:
        assert again == folder


def test_the_lock_ends_with_the_process(tmp_path: Path) -> None:
    script = f"""
from pathlib import Path
from cls_bench.claims import claimed_folder
with claimed_folder(Path({str(tmp_path / "sweep")!r}), 0.0) as folder:
    print(folder.name, flush=True)
    input()
"""
    process = subprocess.Popen([sys.executable, "-c", script], stdin=-1, stdout=-1, text=True)
    assert process.stdout is not None and process.stdout.readline() == "sweep\n"
    later = time.time() + 1.0
    with claimed_folder(tmp_path / "sweep", later) as other:
        assert other.name == "sweep-2"
    process.kill()
    process.communicate()
    with claimed_folder(tmp_path / "sweep", later) as mine:
        assert mine.name == "sweep"


def test_a_page_is_replaced_by_its_owner_only(tmp_path: Path) -> None:
    def write(owner: str) -> str:
        with claimed_page(tmp_path / "reports", "run", owner) as page:
            write_text(page, f"<html><head>{page_mark(owner)}</head>{owner}</html>")
        return page.name

    assert [write(owner) for owner in ("a/run.mcap", "b/run.mcap", "a/run.mcap", "b/run.mcap")] == [
        "run.html", "run-2.html", "run.html", "run-2.html",
    ]  # fmt: skip
    with pytest.raises(KeyError), claimed_page(tmp_path / "reports", "run", "c") as page:
        raise KeyError
    assert page.name == "run-3.html" and names(tmp_path / "reports") == ["run-2.html", "run.html"]
    with ThreadPoolExecutor(10) as pool:
        assert len(set(pool.map(write, (f"{k}/run.mcap" for k in range(10))))) == 10
