"""Reading a job file: TOML in, a validated `Job` out, or every error at once."""

import difflib
import hashlib
import json
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

from netfall.errors import InputError
from netfall.job.schema import GENERATOR_KEYS, GROUP_KEYS, REQUIRED, SECTIONS, Key
from netfall.wind.davenport import GUST_LENGTH

MOST_ROWS = 2e6  # some 500 bytes each on every rank
MOST_SAMPLES = 1e8  # 8 bytes each on every rank
LONGEST_GUST = 24_000  # samples, for which the model of the gusts takes seconds to make


@dataclass(frozen=True)
class Job:
    """A validated job. A section is a namespace of its keys, or None where the scene does not have it."""

    path: Path
    text: str  # the file as it stands
    overrides: tuple[str, ...]  # the --set of the command line
    title: str
    net: SimpleNamespace
    cable: SimpleNamespace
    groups: dict[str, dict]  # [cable.GROUP]: the keys that it overrides
    form_finding: SimpleNamespace | None
    load: SimpleNamespace | None
    roof: SimpleNamespace | None
    wind: SimpleNamespace | None
    dynamics: SimpleNamespace | None
    output: SimpleNamespace

    @property
    def name(self) -> str:
        """The job file's name without its ending."""
        return self.path.stem

    def files(self) -> list[Path]:
        """The files that the job reads: tables of the net and of the wind."""
        named = [self.net.nodes, self.net.elements, self.wind and self.wind.file]
        return [self.path.parent / name for name in named if name]

    def digest(self) -> str:
        """Fingerprint of what was asked: the job file, the values that overrides leave, and all files that it reads.

        Raises InputError for a file that cannot be read.
        """
        kept = {name: value for name, value in vars(self).items() if name not in ("path", "overrides")}
        total = hashlib.sha256(json.dumps(kept, default=vars, sort_keys=True).encode())
        for path in self.files():
            try:
                total.update(hashlib.sha256(path.read_bytes()).digest())
            except OSError as error:
                raise InputError(
                    f"{path}: {error.strerror or error}; paths are relative to the job file"
                ) from None
        return total.hexdigest()

    def given(self) -> set[str]:
        """The keys that the job file or an override gives, as "section.key"."""
        data = tomllib.loads(self.text)
        _apply_overrides(data, list(self.overrides), [])
        tables = {name: table for name, table in data.items() if isinstance(table, dict)}
        return {f"{name}.{key}" for name, table in tables.items() for key in table}

    def changes_net(self) -> bool:
        """Whether the command line overrides the net, so that files made for the job's own net do not apply."""
        return any(o.startswith("net.") for o in self.overrides)


def read_job(path: str | Path, overrides: list[str] = ()) -> Job:
    """Job of a TOML file with `SECTION.KEY=VALUE` overrides.

    Raises
    ------
    InputError : one line for each thing that is wrong
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")  # a byte-order mark is not part of it
        data = tomllib.loads(text)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; give the path of a job file") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not a text file (byte {error.start} is not UTF-8); expected a TOML job file"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None
    errors: list[str] = []
    _apply_overrides(data, overrides, errors)
    job = _Validation(str(path), errors).job(path, text, tuple(overrides), data)
    errors = errors or _absurd_counts(job) + _slow_gusts(job)
    if errors:
        raise InputError(errors)
    return job


def _absurd_counts(job: Job) -> list[str]:
    """Numbers of rows and samples that no machine holds."""
    if job.dynamics is None:
        return []
    duration, wind = job.dynamics.duration, job.wind
    asked = [("output", "history", duration / job.output.history, "rows", MOST_ROWS)]
    if job.output.checkpoint:
        asked.append(("output", "checkpoint", duration / job.output.checkpoint, "checkpoints", MOST_ROWS))
    if wind and not wind.file:
        asked.append(
            (
                "wind",
                "time_step",
                duration / wind.time_step * wind.control_points,
                "wind speeds",
                MOST_SAMPLES,
            )
        )
    return [
        f"{job.path}: [{section}] {key} = {getattr(getattr(job, section), key):g}: asks for {number:.3g} {what} over the duration; "
        f"at most {most:.0e} are possible"
        for section, key, number, what, most in asked
        if number > most
    ]


def _slow_gusts(job: Job) -> list[str]:
    """A wind so slow, or a step so short, that the model of its gusts takes minutes to make."""
    wind = job.wind
    if wind is None or wind.file or wind.roughness == 0:
        return []
    samples = GUST_LENGTH / (wind.speed * wind.time_step)
    if samples <= LONGEST_GUST:
        return []
    least = GUST_LENGTH / LONGEST_GUST / wind.speed
    return [
        f"{job.path}: [wind] speed = {wind.speed:g}: a gust of {GUST_LENGTH:g} m lasts {samples:.3g} samples of time_step = "
        f"{wind.time_step:g} s; at most {LONGEST_GUST} are possible; expected [wind] time_step >= {least:.3g}, or roughness = 0 "
        "for a wind without gusts"
    ]


def _apply_overrides(data: dict, overrides: list[str], errors: list[str]) -> None:
    for override in overrides:
        name, equals, value = override.partition("=")
        *section, key = [part.strip() for part in name.split(".")]
        if not equals or not key or (not section and key != "title"):
            errors.append(f"--set {override}: expected SECTION.KEY=VALUE, for example wind.speed=45")
            continue
        table = data
        for part in section:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                errors.append(f"--set {override}: {part} is a key, not a section")
                break
        else:
            table[key] = _toml_value(value.strip())


def _toml_value(text: str):
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text  # a word without quotes


def shown(value) -> str:
    """A value as it would stand in the job file, cut to a readable length."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known) -> str:
    """Advice that names the nearest known word, or all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else "known: " + ", ".join(known)


def _is_number(value) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def fits(key: Key, value) -> bool:
    """Whether a value is what the key's row of the table allows."""
    if key.kind == "text":
        return isinstance(value, str) and (value != "" or key.name == "title") and "\x00" not in value
    if key.kind == "choice":
        return isinstance(value, str) and value in key.choices
    if key.kind == "flag":
        return isinstance(value, bool)
    if key.kind == "points":
        return isinstance(value, list) and all(
            isinstance(p, list) and len(p) == 2 and all(map(_is_number, p)) for p in value
        )
    if key.kind == "words":
        return isinstance(value, list) and value != [] and all(isinstance(v, str) and v for v in value)
    if key.kind == "pressure" and _is_number(value):
        return True
    if key.kind in ("vector", "pressure"):
        return (
            isinstance(value, list)
            and len(value) == 3
            and all(_is_number(v) and _in_range(key, v) for v in value)
        )
    if value in key.also:
        return True
    if key.kind == "integer" and not isinstance(value, int):
        return False
    return _is_number(value) and _in_range(key, value)


def _in_range(key: Key, value) -> bool:
    above = key.low is None or value > key.low or (value == key.low and not key.low_open)
    below = key.high is None or value < key.high or (value == key.high and not key.high_open)
    return above and below


class _Validation:
    """Checks a job's tables against the schema, collecting a line for each error."""

    def __init__(self, where: str, errors: list[str]):
        self.where = where
        self.errors = errors

    def wrong(self, section: str, what: str) -> None:
        place = f"[{section}] " if section else ""
        self.errors.append(f"{self.where}: {place}{what}")

    def job(self, path, text, overrides, data) -> Job:
        sections = {name: data[name] for name in data if isinstance(data[name], dict)}
        for name in sections:
            if name not in SECTIONS:
                self.wrong("", f"[{name}]: unknown section; {nearest(name, filter(None, SECTIONS))}")
        for name in SECTIONS:
            if name and name in data and name not in sections:
                self.wrong("", f"{name} = {shown(data[name])}: expected a section, [{name}]")
        top = self.section("", {k: v for k, v in data.items() if k not in sections and k not in SECTIONS})
        for name in ("net", "cable"):
            if name not in data:
                self.wrong("", f"[{name}]: the section is missing; a job needs it")
        cable = sections.get("cable", {})
        groups = {k: v for k, v in cable.items() if isinstance(v, dict)}
        parts = {
            name: self.section(name, table)
            for name, table in sections.items()
            if name in SECTIONS and name != "cable"
        }
        if "cable" in sections:
            parts["cable"] = self.section("cable", {k: v for k, v in cable.items() if k not in groups})
        groups = {name: self.group(name, table) for name, table in groups.items()}
        output = parts.get("output") or self.section("output", {})
        self.combinations(sections, parts)
        return Job(
            path,
            text,
            overrides,
            top.title,
            parts.get("net"),
            parts.get("cable"),
            groups,
            parts.get("form_finding"),
            parts.get("load"),
            parts.get("roof"),
            parts.get("wind"),
            parts.get("dynamics"),
            output,
        )

    def section(self, name: str, table: dict) -> SimpleNamespace:
        keys = {key.name: key for key in SECTIONS[name]}
        values = {key.name: key.default for key in SECTIONS[name]}
        self.check(name, keys, table, values)
        for key in keys.values():
            if key.default is REQUIRED and key.name not in table:
                self.wrong(name, f"{key.name}: missing; expected {key.expected()}")
        return SimpleNamespace(**values)

    def group(self, name: str, table: dict) -> dict:
        values: dict = {}
        self.check(f"cable.{name}", {key.name: key for key in GROUP_KEYS}, table, values)
        return values

    def check(self, section: str, keys: dict[str, Key], table: dict, values: dict) -> None:
        for name, value in table.items():
            if name not in keys:
                self.wrong(section, f"{shown(name)[1:-1]}: unknown key; {nearest(name, keys)}")
            elif not fits(keys[name], value):
                self.wrong(section, f"{name} = {shown(value)}: expected {keys[name].expected()}")
            else:
                values[name] = (
                    float(value) if keys[name].kind == "number" and not isinstance(value, str) else value
                )

    def combinations(self, sections: dict, parts: dict) -> None:
        net = sections.get("net")
        if net is not None:
            tables = "nodes" in net or "elements" in net
            if "generator" in net and tables:
                self.wrong(
                    "net", "generator and tables (nodes, elements) exclude each other; keep one of the two"
                )
            elif tables and not ("nodes" in net and "elements" in net):
                missing = "elements" if "nodes" in net else "nodes"
                self.wrong("net", f"{missing}: missing; tables come as a pair, nodes and elements")
            elif "generator" not in net and not tables:
                self.wrong(
                    "net",
                    'generator: missing; expected generator = "saddle" or "stadium", or nodes and elements',
                )
            if net.get("unit", "m") != "m" and not tables:
                self.wrong("net", f"unit = {shown(net['unit'])}: only for tables; dimensions are in m")
            generator = net.get("generator")
            if tables or (isinstance(generator, str) and generator in GENERATOR_KEYS):
                own = () if tables else GENERATOR_KEYS[generator]
                for other, names in GENERATOR_KEYS.items():
                    for name in names:
                        if name in net and name not in own:
                            self.wrong(
                                "net",
                                f'{name} = {shown(net[name])}: only for generator = "{other}"; remove it',
                            )
        wind = sections.get("wind")
        if wind is not None:
            if "speed" in wind and "file" in wind:
                self.wrong("wind", "speed and file exclude each other; keep one of the two")
            elif "speed" not in wind and "file" not in wind:
                self.wrong(
                    "wind", "speed: missing; expected a number of m/s > 0, or file = a table of time, speed"
                )
        moves, cable = parts.get("dynamics"), sections.get("cable", {})
        breaks = any(
            "fracture_strain" in table for table in (cable, *cable.values()) if isinstance(table, dict)
        )
        if moves is not None and moves.mass_scaling and moves.fragments and breaks:
            self.wrong(
                "dynamics",
                f"mass_scaling = {shown(moves.mass_scaling)}: a fragment would take the added inertia along as mass; allowed with fragments = false, or where nothing can break",
            )
        if wind is not None and "dynamics" not in sections:
            self.wrong("wind", "there is no [dynamics] that the wind could act in; add it or remove [wind]")
        if (
            "form_finding" in sections
            and "cable" in parts
            and sections["form_finding"].get("method", "fpm") == "fpm"
        ):
            if not (
                parts["cable"].prestress
                or any("prestress" in g for g in sections["cable"].values() if isinstance(g, dict))
                or (net or {}).get("elements")
            ):
                self.wrong(
                    "cable",
                    "prestress: missing or 0; form finding needs the tension to find the form with, a number of N > 0",
                )
