"""Labels under seal: what is hidden is fixed before the diagnosis starts, and read only after its answer is fixed.

The labels are salted and hashed, the hash is written, the labels themselves lie enciphered beside it; the salt, which
is the key too, is kept by the one process that runs the trial until the answer has been hashed, and published then.
Each step is an entry in the trial's journal, chained to the one before::

    labels sealed  sha256(salt + labels)
    answer sealed  sha256(answer)           again for each answer that follows an experiment
    labels opened  salt

The hash of the labels also stands in a register of the whole exam.  `broken` repeats all of it from the files.
The cipher (XOR with SHAKE-256 of the salt) only keeps honest programs from reading by accident what is not theirs.
"""

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

LABELS, JOURNAL, REGISTER = "labels.bin", "journal.json", "register.jsonl"
SEALED, ANSWERED, OPENED = "labels sealed", "answer sealed", "labels opened"


class SealError(Exception):
    """A seal that is broken, or would be."""


def digest(*parts: bytes) -> str:
    """SHA-256 of the parts, one after the other."""
    hashed = hashlib.sha256()
    for part in parts:
        hashed.update(part)
    return hashed.hexdigest()


def enciphered(content: bytes, salt: bytes) -> bytes:
    """The content under the key `salt`; applied twice it is the content again."""
    key = np.frombuffer(hashlib.shake_256(salt).digest(len(content)), dtype=np.uint8)
    return (np.frombuffer(content, dtype=np.uint8) ^ key).tobytes()


def answer_digest(folder: Path) -> str:
    """Hash of all files of an answer, names and contents."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return digest(*(part for path in files for part in (str(path.relative_to(folder)).encode(), path.read_bytes())))


class Seal:
    """The labels of one trial between sealing and opening; whoever has not made it has not the key."""

    def __init__(self, folder: Path, labels: bytes, register: Path) -> None:
        """Write hash, enciphered labels, journal, and a line of the register."""
        self.folder, self._salt, self._open = folder, os.urandom(32), b""
        commitment = digest(self._salt, labels)
        (folder / LABELS).write_bytes(enciphered(labels, self._salt))
        _write(folder, [])
        _enter(folder, SEALED, commitment)
        line = json.dumps({"trial": folder.name, "sha256": commitment}) + "\n"
        with register.open("a", encoding="utf-8") as file:
            file.write(line)

    def answered(self, answer: Path) -> None:
        """The answer is in: fix it."""
        _enter(self.folder, ANSWERED, answer_digest(answer))

    def opened(self) -> bytes:
        """The labels; raises SealError before the answer is fixed, or where they are not those that were sealed."""
        events = [entry["event"] for entry in _read(self.folder)]
        _enter(self.folder, OPENED, self._salt.hex())
        if ANSWERED not in events:
            raise SealError("the truth was opened before the answer was sealed")
        labels = enciphered((self.folder / LABELS).read_bytes(), self._salt)
        if digest(self._salt, labels) != _read(self.folder)[0]["sha256"]:
            raise SealError("the labels are not those that were sealed")
        self._open = labels
        return labels

    def again(self) -> bytes:
        """The labels once they were opened; raises SealError before."""
        if not self._open:
            raise SealError("the labels were not opened yet")
        return self._open


def broken(folder: Path, answers: Sequence[Path], register: Path) -> list[str]:
    """What is wrong with the seals of a finished trial, from its files alone; nothing where all holds.

    `answers` are the folders of all its answers, in their order.
    """
    try:
        events = _read(folder)
        complaint = _order(events, len(answers))
        if not complaint:
            complaint = _contents(folder, answers, events, registered(register).get(folder.name))
    except (OSError, ValueError, KeyError, TypeError) as error:
        return [f"the journal cannot be read: {type(error).__name__}: {error}"]
    return complaint


def _order(events: Sequence[dict[str, Any]], answers: int) -> list[str]:
    names, chain = [event["event"] for event in events], ""
    for event in events:
        chain = _link(chain, event["event"], event["sha256"])
        if chain != event["chain"]:
            return [f"the entry '{event['event']}' of the journal was changed"]
    if OPENED in names and (ANSWERED not in names or names.index(OPENED) < names.index(ANSWERED)):
        return ["the truth was opened before the answer was sealed"]
    wanted = [SEALED, *[ANSWERED] * answers, OPENED]
    return [] if names == wanted else [f"the journal says: {', '.join(names)}; must be {', '.join(wanted)}"]


def _contents(folder: Path, answers: Sequence[Path], events: Sequence[dict[str, Any]], known: str | None) -> list[str]:
    sealed, *answered, salt = (event["sha256"] for event in events)
    key, complaints = bytes.fromhex(salt), []
    if digest(key, enciphered((folder / LABELS).read_bytes(), key)) != sealed:
        complaints.append("the labels are not those that were sealed")
    if known != sealed:
        complaints.append("the hash of the labels is not that in the exam's register")
    changed = [path.name for path, known in zip(answers, answered, strict=True) if answer_digest(path) != known]
    return [*complaints, *(f"the {name} is not the one that was sealed" for name in changed)]


def registered(register: Path) -> dict[str, str]:
    """Hash of the labels by trial; of a trial that was begun again the last."""
    lines = [json.loads(line) for line in register.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    return {line["trial"]: line["sha256"] for line in lines}


def _link(before: str, event: str, content: str) -> str:
    return digest(before.encode(), event.encode(), content.encode())


def _enter(folder: Path, event: str, content: str) -> None:
    events = _read(folder)
    before = events[-1]["chain"] if events else ""
    _write(folder, [*events, {"event": event, "sha256": content, "chain": _link(before, event, content)}])


def _read(folder: Path) -> list[dict[str, Any]]:
    answer: list[dict[str, Any]] = json.loads((folder / JOURNAL).read_text(encoding="utf-8"))
    return answer


def _write(folder: Path, events: list[dict[str, Any]]) -> None:
    (folder / JOURNAL).write_text(json.dumps(events, indent=1) + "\n", encoding="utf-8")
