"""Look up a topic in the shipped pages: a page, a section, or a row of a table of the reference.

Everything comes from the text of the pages, so that `netfall docs` starts at once and needs no network.
"""

import difflib
import re
import textwrap
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import NamedTuple

from netfall.core.errors import InputError
from netfall.core.messages import tables_of
from netfall.docs import messages

ALL_PAGES = "pages"  # topic that stands for the list of pages
WIDTH = 100  # characters of a printed line
MAX_SUGGESTIONS = 5  # names that an unknown topic is answered with
FIRST_PAGES = ("reference/job/", "reference/", "how-to/")  # of pages with one name, these come first
NAME = re.compile(r"`([^`]+)`")
LINK = re.compile(r"\[([^\]]*(?:\[[^\]]*\][^\]]*)*)\]\([^)\s]+\)")


class Topic(NamedTuple):
    """Something that a user can ask for: its full name, all its names in lower case, page and text."""

    name: str
    names: tuple[str, ...]
    page: str
    text: str


def pages() -> dict[str, str]:
    """Return the texts of all shipped pages by path without ending, "how-to/snow"."""
    return dict(sorted(_pages_of(files("netfall.docs") / "pages", "")))


def _pages_of(folder: Traversable, prefix: str) -> list[tuple[str, str]]:
    texts = []
    for item in folder.iterdir():
        if item.is_dir():
            texts += _pages_of(item, f"{prefix}{item.name}/")
        elif item.name.endswith(".md"):
            texts.append((prefix + item.name.removesuffix(".md"), item.read_text(encoding="utf-8")))
    return texts


def title(text: str) -> str:
    """Return the first heading of a page."""
    return next((line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")), "")


def contents(texts: dict[str, str]) -> str:
    """Return the list of pages with their titles."""
    width = max(map(len, texts))
    rows = [f"{path:{width}}  {title(text)}" for path, text in texts.items()]
    return "\n".join(
        [*rows, "", "netfall docs TOPIC prints a page, key, column, dataset, command or message code."]
    )


def find(topic: str) -> str:
    """Return the text on a topic. Raises InputError with the nearest names and pages if there is none."""
    wanted, texts = _normal(topic), pages()
    if wanted == ALL_PAGES:
        return contents(texts)
    topics = [one for path, text in texts.items() for one in topics_of(path, text)]
    matches = _named(wanted, topics)
    file = wanted.removesuffix(".md")
    if paths := [path for path in texts if file in (path.lower(), path.rpartition("/")[2].lower())]:
        first, *others = sorted(paths, key=lambda path: (path.lower() != file, _rank(path)))
        others += [one.name for one in matches]
        also = f"\n\nSee also: {', '.join(f'netfall docs {other}' for other in others)}" if others else ""
        return plain(texts[first]) + also
    if matches:
        return "\n\n".join(f"{one.name} ({one.page})\n{one.text}" for one in matches)
    if section := re.match(r"(limits)\.group\b|(?:load|wind)\.(zone)\b", wanted):  # a page has two sections
        return find(section[1] or section[2])
    known = {name for one in topics for name in one.names} | {path.rpartition("/")[2] for path in texts}
    nearest = difflib.get_close_matches(wanted, sorted(known), MAX_SUGGESTIONS)
    count = {path: text.lower().count(wanted) for path, text in texts.items()}
    most = sorted((path for path in texts if count[path]), key=lambda path: -count[path])[:MAX_SUGGESTIONS]
    hints = [f"did you mean {', '.join(nearest)}?"] if nearest else []
    hints += [f"pages with this text: {', '.join(most)}"] if most else []
    raise InputError(
        messages.UNKNOWN_TOPIC(topic=topic, advice="; ".join(hints) or "netfall docs lists the pages")
    )


def _named(wanted: str, topics: list[Topic]) -> list[Topic]:
    """Return the topics of a name; keys of groups and zones are those of their section."""
    section, _, last = wanted.rpartition(".")
    section = section.partition(".")[0]
    for name in (wanted, f"{'cable' if section == 'group' else section}.{last}"):
        full = [one for one in topics if name == one.name.lower()]
        if matches := full or [one for one in topics if name in one.names]:
            return matches
    return []


def _rank(path: str) -> int:
    return next((k for k, start in enumerate(FIRST_PAGES) if path.startswith(start)), len(FIRST_PAGES))


def _normal(topic: str) -> str:
    """Return a topic in lower case without marks: "[wind] speed" is wind.speed, "/net/angle" net.angle."""
    bare = topic.strip().strip("[]`").removeprefix("netfall ").lstrip("/")
    return re.sub(r"\]+\.?\s*", ".", bare).lower()


def topics_of(page: str, text: str) -> list[Topic]:
    """Return the sections and table rows of a page of the reference, as topics."""
    if not page.startswith("reference/"):
        return []
    topics, section = [], ""
    code = re.compile(r"^```.*?^```", re.M | re.S)  # no line of it is a heading
    text = code.sub(lambda block: block[0].replace("\n#", "\n #"), text)
    for block in re.split(r"^(?=#)", text, flags=re.M):
        heading, _, body = block.partition("\n")
        if not heading.startswith("#"):
            continue
        section = _normal(heading.lstrip("# ").replace("and [group.NAME]", ""))
        if heading.startswith("##"):
            topics.append(Topic(section, (section,), page, plain(body)))
        topics += [row for table in tables_of(body) for row in _row_topics(page, section, table)]
    return topics


def _row_topics(page: str, section: str, table: list[list[str]]) -> list[Topic]:
    """Return a topic for each row whose first cell holds names in code marks."""
    head, *rows = table
    topics = []
    for first, *cells in rows:
        names = [re.split(r"[ (|]", name)[0] for name in NAME.findall(first)]
        names = [name for name in names if name]
        if names:
            full = [f"{section}.{name}" for name in names]
            every = (*full, *(f"{section}/{name}" for name in names), *(name.lstrip("-") for name in names))
            name, text = full[0], _row_text(head, [first, *cells])
            if page == "reference/messages":  # templates with literal braces
                name, text = names[0], text.replace("{{", "{").replace("}}", "}")
            topics.append(Topic(name, tuple(map(str.lower, every)), page, text))
    return topics


def _row_text(head: list[str], cells: list[str]) -> str:
    """Return a row as a paragraph: its first cell, its last one, then the others with their heads."""
    name, *middle, last = map(plain_line, cells)
    others = [f"{column}: {cell}" for column, cell in zip(head[1:-1], middle) if cell]
    wrap = textwrap.TextWrapper(
        WIDTH, initial_indent="    ", subsequent_indent="    ", break_long_words=False
    )
    return "\n".join([f"  {name}", *(wrap.fill(line) for line in (last, "; ".join(others)) if line)])


def plain_line(text: str) -> str:
    """Return a line without links and code marks."""
    return LINK.sub(r"\1", text).replace("`", "").replace("\\|", "|")


def plain(text: str) -> str:
    """Return a page for a terminal: without comments and links, each row of a table as a paragraph."""
    text = re.sub(r"<!--.*?-->\n?", "", text)
    shown = []
    for part in re.split(r"(^```[\s\S]*?^```|(?:^\|.*\n?)+)", text, flags=re.M):
        if part.startswith("|"):
            head, *rows = tables_of(part)[0]
            shown.append("\n".join(_row_text(head, row) for row in rows) + "\n")
        else:
            shown.append(part if part.startswith("```") else LINK.sub(r"\1", part))
    return re.sub(r"\n{3,}", "\n\n", "".join(shown)).strip()
