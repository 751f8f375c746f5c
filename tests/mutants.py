"""Mutants of texts that users write: seeded, so that a number names a mutant for good.

A mutant is a good text in which one to four things were changed: a value, by one that is hostile to some parser or
type; a line, doubled, dropped or moved; a table's head; letters anywhere; or the end, cut off.
"""

import gzip
import os
import random
import re
import traceback
from collections.abc import Callable, Sequence

from swarm.errors import SwarmError

COUNT = int(os.environ.get("SWARM_FUZZ_MUTANTS", "2000"))
"""Mutants per kind of input. 30 000 take some minutes: SWARM_FUZZ_MUTANTS=30000 python -m pytest tests/test_fuzz.py"""

HOSTILE = (
    *("0", "-1", "1", "2", "3.5", "-0.0", "1e-300", "1e300", "1e-9", "5e-324", "nan", "inf", "-inf", "true", "false"),
    *('""', '"x"', '"s.toml"', '"hold"', '"../../x"', '"~nosuchuser/x"', '"/dev/zero"', '"/dev/null"', '"."', '"/"'),
    *(r'"a\u0000b"', r'"\uD800"', '"' + "a" * 300 + '"', '"' + "a/" * 3000 + '"', '"é\u202e\U0001f680"', "'\\'"),
    *("[]", "{}", "[[]]", "[1, 2]", "[1, 2, 3]", '["a", 1]', "{ kind = 'hold' }", "{ a = 1 }", "[{}]", "[[1,2,3]]"),
    *("1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", "9999-99-99", "0x" + "f" * 40, "0x" + "f" * 9000, "9" * 5000),
    *("-" + "9" * 400, "9223372036854775807", "9223372036854775808", "1e400", "[" * 3000, "[" * 60 + "]" * 60, "null"),
    *("{ " * 40, "a", "", "=", '"""', "'''a\nb'''", "{a=" * 900, '"%s"', '"[bold]"', "1_000", "\x00", "\x7f", "\ufeff"),
)
LETTERS = "\"'[]{}=.,#\n\r\t \\-_0129eEaxT:\x00\x01\x7f\u00e9\u2028\ud800"
FOREIGN = re.compile(r"pydantic|constrained-|valid dictionary|function-|Input should|tuple\[|json-or-python")
"""Words of the libraries behind the door, which mean nothing to a user."""
VALUE = re.compile(r"(?<=[=:,\[])\s*(\"[^\"\n]*\"|'[^'\n]*'|[-+\w.]+|\[[^\[\]\n]*\])")


def mutant(texts: Sequence[str], number: int) -> str:
    """Return mutant `number` of these texts."""
    rng = random.Random(number)
    text = rng.choice(texts)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        text = rng.choice((_value, _value, _value, _value, _line, _head, _letters, _cut))(text, rng)
    return text


def tracebacks(texts: Sequence[str], read: Callable[[str], object]) -> list[str]:
    """Read every mutant, and return the last lines of each traceback that is not a `SwarmError`."""
    found = []
    for number in range(COUNT):
        text = mutant(texts, number)
        try:
            read(text)
        except SwarmError as error:
            message = str(error)
            if not message or FOREIGN.search(message) or len(message) > 20_000:
                found.append(f"mutant {number}: the message is {message[:200]!r}")
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            found.append(f"mutant {number}: {type(error).__name__}: {error!s:.200} at {place.filename}:{place.lineno}")
    return found


def _value(text: str, rng: random.Random) -> str:
    places = list(VALUE.finditer(text))
    if not places:
        return text + rng.choice(HOSTILE)
    place = rng.choice(places)
    return f"{text[: place.start()]} {rng.choice(HOSTILE)}{text[place.end() :]}"


def _line(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    how = rng.randrange(4)
    if how == 0:
        lines.insert(j, lines[i])
    elif how == 1:
        del lines[i]
    elif how == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines.insert(j, f"{rng.choice(('name', 'seed', 'swarm', 'craft', 'navigation', 'x'))} = {rng.choice(HOSTILE)}")
    return "\n".join(lines)


def _head(text: str, rng: random.Random) -> str:
    words = re.findall(r"[A-Za-z_]\w*", text)
    if not words:
        return text
    old, new = rng.choice(words), rng.choice([*words, "", "kind", "a.b", "x" * 400])
    return re.sub(rf"\b{old}\b", lambda _: new, text, count=rng.choice((0, 1)))


def _letters(text: str, rng: random.Random) -> str:
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(text) + 1)
        text = text[:at] + rng.choice(LETTERS) + text[at + rng.randrange(2) :]
    return text


def _cut(text: str, rng: random.Random) -> str:
    return text[: rng.randrange(len(text) + 1)]


LIGHTHOUSE_2 = ("W {c} {k} {tick} 0", "B {c} {k} {tick} 0 +0.310936", "Y {c} {tick} 1", "W 6", "B x y z")
POSES = (
    "1 2 3 1 0 0 0",
    "1 2 3 1 0 0 0 -1001",
    "1 2 3 1 0 0 0 LHB-FFFFFC17",
    "1 2 3 0 0 0 0",
    "nan nan nan 1 0 0 0",
    "1e308 1e308 1e308 1e308 1e308 1e308 1e308",
    "1 2 3",
    "1 2 3 1 0 0 0 7 8",
    "inf 0 0 1 0 0 0",
    "0 0 0 1 0 0 0 " + "9" * 400,
)
TICKS = ("0", "-1", "4294967295", "4294967296", "2147483648", "9" * 30, "1e9", "nan", "0x10", "", "1_000", "99999999")
TIMES = ("0", "-1e9", "1e9", "1e308", "nan", "inf", "86400", "1e-300", "x")


def recording_mutant(text: str, number: int) -> bytes:
    """Return mutant `number` of a recording: lines or bytes damaged as disks, cables and editors do, or by spite."""
    rng = random.Random(number)
    lines = text.split("\n")
    for _ in range(rng.choice((1, 1, 2, 3))):
        lines = rng.choice((_repeated, _reordered, _dropped, _word, _word, _stations, _second_generation, _config))(
            lines, rng
        )
    data = (
        ("\r\n" if rng.random() < 0.05 else "\n")
        .join(lines)
        .encode(rng.choice(("utf-8",) * 9 + ("utf-16",)), "replace")
    )
    if rng.random() < 0.2:
        data = _flipped(data, rng)
    if rng.random() < 0.5:
        data = gzip.compress(data, 1, mtime=0)
        how = rng.randrange(4)
        data = data[: rng.randrange(len(data))] if how == 0 else _flipped(data, rng) if how == 1 else data
    return data + rng.choice((b"", b"", b"", b"\x00" * 5000, b"\n" * 5000, b"\x1f\x8b"))


def _flipped(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 3, 50))):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _some(lines: list[str], rng: random.Random) -> tuple[int, int]:
    first = rng.randrange(len(lines) + 1)
    return first, min(len(lines), first + rng.choice((1, 10, 1000)))


def _repeated(lines: list[str], rng: random.Random) -> list[str]:
    first, last = _some(lines, rng)
    at = rng.randrange(len(lines) + 1)
    return lines[:at] + lines[first:last] * rng.choice((1, 2)) + lines[at:]


def _reordered(lines: list[str], rng: random.Random) -> list[str]:
    first, last = _some(lines, rng)
    block = lines[first:last]
    rng.shuffle(block)
    return lines[:first] + block + lines[last:]


def _dropped(lines: list[str], rng: random.Random) -> list[str]:
    first, last = _some(lines, rng)
    return lines[:first] + lines[last:]


def _word(lines: list[str], rng: random.Random) -> list[str]:
    """Replace one word of some lines: a tick, a time, or anything."""
    out = list(lines)
    place = rng.randrange(8)
    new = rng.choice(TIMES if place == 0 else TICKS if place in (4, 5) else HOSTILE)
    for _ in range(rng.choice((1, 1, 20, 2000))):
        i = rng.randrange(max(len(out), 1)) if out else 0
        words = out[i].split(" ") if out else []
        if place < len(words) and "CONFIG" not in words:
            words[place] = new
            out[i] = " ".join(words)
    return out


def _stations(lines: list[str], rng: random.Random) -> list[str]:
    pose = f"{rng.choice(('0', '1', '2', '17', '-1', 'x'))} LH_POSE {rng.choice(POSES)}"
    at = rng.randrange(len(lines) + 1)
    return [*lines[:at], f"{rng.choice(('1.0', 'nan', '0'))} {pose}", *lines[at:]]


def _second_generation(lines: list[str], rng: random.Random) -> list[str]:
    out: list[str] = []
    every, only = rng.choice((2, 50)), rng.random() < 0.3
    for i, line in enumerate(lines):
        words = line.split(" ")
        light = len(words) > 4 and words[2] in ("C", "A")
        if light and i % every == 0:
            new = rng.choice(LIGHTHOUSE_2).format(c=6, k=words[3], tick=words[4])
            out.append(f"{words[0]} {words[1]} {new}")
        if not (light and only):
            out.append(line)
    return out


def _config(lines: list[str], rng: random.Random) -> list[str]:
    out = list(lines)
    for i, line in enumerate(out):
        head, mark, config = line.partition("CONFIG ")
        if mark:
            out[i] = head + mark + mutant([config], rng.randrange(10**6)).replace("\n", " ")
    return out


def event_log_mutant(data: bytes, number: int) -> bytes:
    """Return mutant `number` of a binary file: bits flipped, bytes set, a part lost, doubled or cut off."""
    rng = random.Random(number)
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 5))):
        if not out:
            break
        # Half of the damage is in the head, where the types are.
        at = rng.randrange(min(len(out), 200)) if rng.random() < 0.5 else rng.randrange(len(out))
        how = rng.randrange(5)
        if how == 0:
            out[at] ^= 1 << rng.randrange(8)
        elif how == 1:
            out[at : at + 4] = rng.choice((b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\xc0\x7f", b"\0\0\x80\x7f"))
        elif how == 2:
            del out[at : at + rng.choice((1, 2, 30, 3000))]
        elif how == 3:
            out[at:at] = out[at : at + rng.choice((1, 30, 3000))]
        else:
            del out[at:]
    return bytes(out)
