"""A corpus of malformed configuration: every line of a good file, broken in every way we know.

Deterministic: the same cases at every run, each with a name, its bytes, and whether it must be refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

FREE_TEXT = {"name", "channel"}  # any printable text is a value here


class Case(NamedTuple):
    """One file that somebody might hand to us."""

    name: str
    content: bytes
    refused: bool | None = None  # None: may be good or bad, but must not surprise
    line: int | None = None  # where the error must point, if it is known


# What may stand in a value's place by mistake or malice; nothing here is ever a good value of any field.
NEVER = (
    "", "null", "~", ".nan", "nan", ".inf", "-.inf", "inf mm", "1e400", "1e400 mm", "1e400 Hz", "-1e999 kg",
    "9" * 400, "9" * 5000, "0x" + "f" * 300, "[1 mm, 2 mm, 3 mm]", "[]", "{}", "{a: 1}", "[[[[1]]]]",
    "12 parsec", "12 MM", "1 mm^99999", "1 m^-9/nm^-9 m^9 m^9", "1,5 mm", "1_0 mm", "1.5.3 mm", "１２ mm",
    "١٢ mm", "1２ Hz", "12 mm mm", "0x1F mm", "12 \\u0000mm", '"12 \\0mm"', '"\\ud800"', '"\\e[2J"',
    '"a\\nb"', "2024-01-31", "12:30:45", "!!python/object/apply:os._exit [3]",
    "!!python/object:os.system {}", "!!binary aGFsbG8=", "!unknown 5 lightyears", "- 5", "? 5", "*nowhere",
    "&anchor", "%5 mm", "@5 mm", "`5 mm`", "'5 mm", '"5 mm', "{5 mm", "[5 mm", "5 mm]", "a: b: c", "|",
    ">\n  5 furlong", "1 " + " " * 70 + "!", "x" * 300, "1 " + "m " * 200, "1 " + "m^2 " * 60, "1/0 m",
    "__import__('os')", "1 lambda", "1 None", "1 nan", "1 m + 1 m", "1 m m^-1 [",
)  # fmt: skip

# Good values of some field, and bad ones of most.
SOMETIMES = (
    "0", "-0", "-1", "1", "+1", "1.0", "1e3", "1_000", "010", "0o17", "0x10", "0b11", "yes", "no", "on",
    "true", "True", "false", "0 mm", "-0 mm", "-1 mm", "1 mm", "1 km", "1e-300 m", "1e300 mm", "40 Hz",
    "40 rad/s", "40 rpm", "1 N m", "1 N", "1 kg", "1 kg m^2", "1 A", "1 mA", "1 N m/A", "1 s", "1 ms",
    "1 min", "1 m/s", "1 m/s^2", "1 rad/s^2", "20 deg", "1 rad", "1 rev", "5 %", "1 bit/s", "1 Mbit/s",
    "1e-320 kg m^2", "1e5 kg m^2", "1e-9 A", "rotary", "linear", "canopen", "simulated", "rolling",
    "stop-operators", "sine", "dwell", "sequence", "csv", "sync", "wall", "../../etc/passwd", "/dev/zero",
    "1\u00a0mm", "&a 1 mm", "!!str 1 mm", "!!float 1 mm", "'1 mm'", '"1 mm"', "[1 mm, 2 mm]",
    "[2 mm, 1 mm]", "[0x6040_00]", "[-5]", "1 1", "1 1/s",
)  # fmt: skip


def without_comments(text: str) -> str:
    """The same configuration, shorter: comments would only slow the corpus down."""
    lines = [line.split("#")[0].rstrip() for line in text.splitlines()]
    return "\n".join(line for line in lines if line) + "\n"


def mutations(text: str) -> Iterator[Case]:
    """Every line of `text` deleted, repeated, renamed, indented otherwise, and with another value."""
    lines = without_comments(text).splitlines()
    for number, line in enumerate(lines):
        key, _, value = line.partition(":")
        word, place = key.strip(), f"{number + 1} {key.strip()}"
        around = lines[:number], lines[number + 1 :]
        yield _case(f"{place} deleted", around, [])
        yield _case(f"{place} twice", around, [line, line] if value else [line, line, "  x: 1"], True)
        yield _case(f"{place} misspelt", around, [line.replace(word, word[:-1] + "x", 1)], True, number + 1)
        yield _case(f"{place} upper case", around, [line.replace(word, word.upper(), 1)], True, number + 1)
        yield _case(f"{place} with a tab", around, ["\t" + line])
        yield _case(f"{place} indented", around, ["   " + line])
        yield _case(f"{place} merged", around, [line, key.replace(word, "<<") + ": {a: 1}"], True)
        for bad in NEVER:
            block = value == "" and bad in ("", "&anchor")  # the block that follows still belongs to it
            refused = None if word in FREE_TEXT or block else True
            yield _case(f"{place} = {bad[:20]}", around, [f"{key}: {bad}"], refused)
        for other in SOMETIMES:
            yield _case(f"{place} = {other}", around, [f"{key}: {other}"])


def _case(
    name: str,
    around: tuple[list[str], list[str]],
    lines: list[str],
    refused: bool | None = None,
    line: int | None = None,
) -> Case:
    whole = [*around[0], *lines, *around[1]]
    return Case(name, ("\n".join(whole) + "\n").encode("utf-8", "surrogatepass"), refused, line)


def files(text: str) -> Iterator[Case]:
    """Whole files that are wrong, or only look so."""
    good = text.encode()
    yield Case("as it is", good, False)
    yield Case("with a byte order mark", b"\xef\xbb\xbf" + good, False)
    yield Case("with carriage returns", good.replace(b"\n", b"\r\n"), False)
    yield Case("with a document start", b"---\n" + good, False)
    yield Case("with an anchor", b"--- &all\n" + good, False)
    yield Case("empty", b"", True, 1)
    yield Case("blank", b"\n \n\n", True, 1)
    yield Case("only comments", b"# nothing\n# at all\n", True, 1)
    yield Case("two documents", good + b"---\n" + good, True)
    yield Case("UTF-16", text.encode("utf-16"), True, 1)
    yield Case("Latin-1", b"# 5 \xb5m\n" + good, True, 1)
    yield Case("NUL", b"# one\n# two\n\x00" + good, True, 3)
    yield Case("escape character", b"# \x1b[2J\n" + good, True, 1)
    yield Case("ELF", b"\x7fELF\x02\x01\x01\x00" + bytes(range(256)), True)
    yield Case("random bytes", bytes((i * 7919 + i * i) % 251 for i in range(4096)), True)
    yield Case("five megabytes", good + b"#" * 5_000_000, True, 1)
    yield Case("a scalar", b"hello", True, 1)
    yield Case("a list", b"- 1\n- 2\n", True, 1)
    yield Case("null", b"null\n", True, 1)
    yield Case("brackets", b"[" * 5000, True, 1)
    yield Case("braces", b"{" * 5000, True, 1)
    yield Case("closed brackets", b"[" * 2000 + b"]" * 2000, True, 1)
    yield Case("lines of brackets", (b"# first\n" + b"[" * 999 + b"]" * 999 + b"\n") * 100, True, 2)
    yield Case("deep blocks", b"".join(b" " * k + b"axis:\n" for k in range(400)), True)
    yield Case("deep parts", b"type: sequence\nparts:\n" + b"".join(_deep(k) for k in range(30)), True)
    yield Case("dashes", b"- " * 3000, True, 1)
    yield Case("tabs", good.replace(b"  ", b"\t"), None)
    yield Case("cut in the middle of a line", good[: len(good) // 2], None)
    yield Case("keys that are lists", b"? [a, b]\n: 1\n" + good, True)
    yield Case("keys that are blocks", b"? {a: b}\n: 1\n" + good, True)
    yield Case("ten thousand keys", b"".join(b"key%d: 1\n" % k for k in range(10_000)), True)
    yield Case("a long key", b"? " + b"k" * 200_000 + b"\n: 1\n", True, 1)
    yield Case("a long value", b"name: " + b"v" * 200_000 + b"\n", True, 1)
    yield Case("spaces", b"type: dwell\nduration: 1" + b" " * 200_000 + b"!\n", True)
    yield Case("itself", b"&a {type: sequence, parts: [*a, *a]}\n", True)
    yield Case("itself in a block", b"&a\naxis: *a\nmotor: *a\n", True)
    yield Case("alias bomb", _bomb(), True)
    yield Case("alias bomb of a stage", _bomb() + good.replace(b"type: ", b"kind: "), True)
    yield Case("directive bomb", b"%YAML " + b"9" * 5000 + b".1\n---\n" + good, True)
    yield Case("strange version", b"%YAML 9.9\n---\n" + good, True)
    yield Case("escape beyond Unicode", b'name: "\\UFFFFFFFF"\n', True)
    yield Case("object", b"!!python/object/apply:os.system ['touch moved']\n", True, 1)
    yield Case("module", b"!!python/module:antigravity\n", True, 1)
    yield Case("two thousand parts", b"type: sequence\nparts:\n" + b"  - {type: dwell, duration: 1 s}\n" * 2000, True)
    yield Case("no parts", b"type: sequence\nparts: []\n", True, 2)
    yield Case("a year", b"type: dwell\nduration: 999999 min\n", True, 2)


def _deep(k: int) -> bytes:
    return b"  " * k + b"- type: sequence\n" + b"  " * k + b"  parts:\n"


def _bomb() -> bytes:
    """A billion laughs: nine levels of ten aliases each."""
    levels = [b"a0: &a0 {type: dwell, duration: 1 s}\n"]
    for k in range(9):
        levels.append(b"a%d: &a%d {type: sequence, parts: [%s]}\n" % (k + 1, k + 1, b", ".join([b"*a%d" % k] * 10)))
    return b"".join(levels) + b"type: sequence\nparts: [*a9]\n"
