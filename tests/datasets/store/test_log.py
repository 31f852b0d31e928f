"""Logs: one a process, locked while it works; a torn record is left out and said."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roundel.datasets.store.folder import Folder
from roundel.datasets.store.lock import one_at_a_time
from roundel.datasets.store.log import Logs, OwnLog
from roundel.datasets.store.records import document_of, line_of, record_of, record_of_document, records_of

scalars = st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False, allow_infinity=False)
values = st.recursive(
    scalars | st.text(), lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3)
)
records = st.dictionaries(st.text().filter(lambda key: key != "sha256"), values, max_size=5)


@given(records, st.data())
def test_a_record_comes_back_and_no_changed_byte_passes(record, data) -> None:
    line = line_of(record).encode()
    assert record_of(line) == record
    at = data.draw(st.integers(0, len(line) - 1))
    assert record_of(line[:at] + bytes([line[at] ^ data.draw(st.integers(1, 255))]) + line[at + 1 :]) is None
    assert record_of(line[:at]) is None


@given(records, st.data())
def test_a_document_comes_back_and_no_changed_byte_passes(record, data) -> None:
    text = document_of(record)
    assert record_of_document(text) == record
    at = data.draw(st.integers(0, len(text) - 1))
    for changed in (text[:at] + bytes([text[at] ^ data.draw(st.integers(1, 255))]) + text[at + 1 :], text[:at]):
        with pytest.raises(ValueError, match=r"."):
            record_of_document(changed)


def read(logs: Logs) -> list[object]:
    return [record["n"] for _, _, record in logs.new_records()]


def test_records_are_read_as_they_come(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    logs, own = Logs(folder), OwnLog(folder, {"who": "me"})
    assert read(logs) == []
    own.append({"n": 1})
    assert read(logs) == [1]
    own.append({"n": 2}, {"n": 3})
    assert read(logs) == [2, 3]
    assert read(logs) == []
    assert logs.is_live(own.name)
    own.close()
    assert not logs.is_live(own.name)
    logs.remove_gone()
    assert not (tmp_path / "log").exists()


def test_a_torn_record_is_left_out_and_said(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    own = OwnLog(folder, {})
    own.append({"n": 1}, {"n": 2})
    own.close()
    path = tmp_path / "log" / f"{own.name}.jsonl"
    whole = path.read_bytes()
    for cut in range(len(whole) - 1, len(line_of({"log": 1})) + 1, -1):
        path.write_bytes(whole[:cut])
        logs = Logs(folder)
        found = read(logs)
        assert found == [1, 2][: len(records_of(whole[:cut])[0]) - 1]
        at_an_end = whole[:cut].endswith(b"\n")
        assert [("cut short" in text) for text in logs.cut()] == ([] if at_an_end else [True])


SCRIPT = """
import sys, time
from pathlib import Path
from roundel.datasets.store.folder import Folder
from roundel.datasets.store.log import OwnLog
log = OwnLog(Folder(Path(sys.argv[1])), {})
log.append({"n": 1})
print("here", flush=True)
time.sleep(60)
"""


def test_a_killed_process_is_known_to_be_gone(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "here\n"
    logs = Logs(Folder(tmp_path))
    assert read(logs) == [1]
    (name,) = Folder(tmp_path).logs().lengths()
    assert logs.is_live(name)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert not logs.is_live(name)


COUNT = """
import sys
from pathlib import Path
from roundel.datasets.store.lock import one_at_a_time
for _ in range(50):
    with one_at_a_time(Path(sys.argv[1]) / ".lock"):
        file = Path(sys.argv[1]) / "count"
        file.write_text(str(int(file.read_text()) + 1))
"""


def test_one_process_at_a_time(tmp_path: Path) -> None:
    (tmp_path / "count").write_text("0")
    many = [subprocess.Popen([sys.executable, "-c", COUNT, str(tmp_path)]) for _ in range(4)]
    assert [process.wait() for process in many] == [0] * 4
    assert (tmp_path / "count").read_text() == "200"
    with one_at_a_time(tmp_path / ".lock"):
        assert (tmp_path / ".lock").exists()
    assert not (tmp_path / ".lock").exists()
