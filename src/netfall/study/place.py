"""Where the files of a study lie."""

from dataclasses import dataclass
from pathlib import Path

SUFFIX, JOURNAL = ".study.h5", ".study.journal"


@dataclass(frozen=True)
class Place:
    """The files of a study, or of a part of it; stem : their name without its ending."""

    folder: Path
    stem: str
    part: str = ""

    @property
    def result(self) -> Path:
        """The study file."""
        return self.folder / f"{self.stem}{self.part}{SUFFIX}"

    @property
    def journal(self) -> Path:
        """The journal."""
        return self.folder / f"{self.stem}{self.part}{JOURNAL}"

    @property
    def members(self) -> Path:
        """The folder of the result files that are kept."""
        return self.folder / f"{self.stem}.members"

    def parts(self) -> list["Place"]:
        """The parts of the study that have been run, whole or not."""
        found = set()
        for suffix in (SUFFIX, JOURNAL):
            for path in self.folder.glob(f"{self.stem}.*-of-*{suffix}"):
                found.add(path.name.removesuffix(suffix).removeprefix(self.stem))
        return [Place(self.folder, self.stem, part) for part in sorted(found)]


def place_of(path: Path, output: Path | None, shard: tuple[int, int] | None) -> Place:
    """Where the results of a study file go."""
    output = output or Path(f"{path.stem}{SUFFIX}")
    stem = output.name.removesuffix(".h5").removesuffix(".study")
    return Place(output.parent, stem, f".{shard[0]}-of-{shard[1]}" if shard else "")
