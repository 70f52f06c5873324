"""Rules of the structure: allowed imports, and the length of files."""

import ast
import sys
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

from netfall.core.cache import PRESENTATION_PACKAGES

PACKAGE = ROOT / "src" / "netfall"

# A package imports only from packages before it.
LAYERS = (
    *("core", "physics", "job", "geometry", "parallel", "loads", "model", "explicit", "gpu", "results"),
    *("statics", "driver", "study", "post", "exchange", "docs", "api", "cli", "__main__"),
)
# Module -> what it may import from later layers: a picture that check draws, the program that a process runs.
MAY_IMPORT = {
    "driver.check": ["post.plots.job"],
    "driver.child_process": ["__main__"],
    "driver.worker": ["__main__"],
}

# Third-party package -> the packages and modules that may import it; numpy and the standard library are free.
PACKAGES = {
    "mpi4py": ["parallel.mpi", "driver.provenance", "__main__"],
    "h5py": ["results", "post", "study", "driver", "loads.wind.measured"],
    "numba": [  # types of fields; the versions for compiled code and for /provenance
        *("core", "physics.fields", "parallel.mpi_calls", "driver.compile", "driver.provenance"),
        "gpu",
    ],
    "llvmlite": ["core", "parallel.mpi_calls", "driver.compile"],
    "scipy": [
        *("geometry.net", "driver.modes", "parallel.subdomain", "statics.multigrid.rows"),
        *("study.sections", "study.answers", "exchange.drawings", "post.plots"),
    ],
    "shapely": ["geometry", "exchange.drawings"],
    "pymetis": ["parallel.partition", "core.sparse"],
    "matplotlib": ["post.plots", "post.page.page"],
    "mpl_toolkits": ["post.plots"],
    "imageio_ffmpeg": ["post.plots.film"],
    "adjustText": ["post.plots.canvas"],
    "vtkmodules": ["exchange.vtu"],
    "k3d": ["post.page.page"],
    "tqdm": ["core.progress"],
    "pydantic": ["job"],
    "annotated_types": ["job.keys.fields"],
    "pint": ["job.units"],
    "ezdxf": ["exchange"],
    "markdown_it": ["post.report.report"],
}

# Modules that work on a machine without MPI -> what they and all that they import must not reach.
WITHOUT = {
    name: ["mpi4py", "driver"]
    for name in ("post.plots.run", "post.report.info", "results.file", "post.report.report")
    + ("post.page.page", "post.plots.study.study", "study.answers.info")
}

# Functions whose last bit numpy and the C library choose by the processor (`core` has its own), and who
# may use them nevertheless: text, pictures and rounded values are not stored.
BY_PROCESSOR = {
    *("log", "log1p", "log2", "log10", "exp", "exp2", "expm1", "sin", "cos", "tan", "sinh", "cosh", "tanh"),
    *("arcsin", "arccos", "arctan", "arctan2", "asin", "acos", "atan", "atan2", "power", "pow", "cbrt"),
    "erf",
}
MAY_BE_INEXACT = [
    *("post", "exchange", "explicit.wind_section", "study.answers"),
    *("geometry.cables", "geometry.generators.ellipse", "driver.reporting.run"),
]

MOST_FILES, LONGEST_CHAIN = 16, 8  # of a package, without packages within it
MOST_LINES = 500


def module_name(path: Path) -> str:
    """Return the name in netfall: "job.read" of job/read.py, "job" of its __init__.py, "" of the package."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix("__init__").rstrip(".")


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def within(name: str, places: list[str]) -> bool:
    """Return whether a module is in one of the packages."""
    return any(name == place or name.startswith(place + ".") for place in places)


@cache
def imports(module: str) -> frozenset[str]:
    """Return the imports of a module, also in functions: netfall's as ".job.read", others by first name."""
    result = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text())):
        if isinstance(node, ast.Import):
            result |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{MODULES[module]}:{node.lineno}: imports by its place, not by its name"
            below = {f"{node.module}.{alias.name}" for alias in node.names}
            modules = {name for name in below if name.removeprefix("netfall.") in MODULES}
            result |= modules if modules else {node.module}
    ours = {name for name in result if name.split(".")[0] == "netfall"}
    return frozenset(
        {"." + name.removeprefix("netfall").removeprefix(".") for name in ours}
        | {name.split(".")[0] for name in result - ours}
    )


def reached(module: str) -> set[str]:
    """Return all direct and indirect imports of a module, as `imports`."""
    result, open_ends = set(), {"." + module}
    while open_ends:
        name = open_ends.pop()
        result.add(name)
        if name.startswith("."):
            open_ends |= imports(name[1:]) - result
    return result


def test_packages_import_only_lower_layers():
    """Exceptions are in MAY_IMPORT."""
    wrong = []
    for module in MODULES:
        layer = module.split(".")[0]
        before = LAYERS[: LAYERS.index(layer) + 1] if layer else ("core", "results", "api")
        allowed = [*before, *MAY_IMPORT.get(module, [])]
        inner = [name[1:] for name in imports(module) if name.startswith(".") and name != "."]
        wrong += [f"{module} imports {name}" for name in inner if not within(name, allowed)]
    assert wrong == []


def test_packages_after_the_driver_only_present_results():
    """A change of these packages leaves finished samples of a study valid."""
    after = LAYERS[LAYERS.index("driver") + 1 : -1]
    assert sorted(PRESENTATION_PACKAGES) == sorted(f"{package}/" for package in after)


def test_external_packages_are_imported_only_in_their_layers():
    """PACKAGES lists the layers of MPI, HDF5, the compiler and pictures."""
    free = {"numpy", *sys.stdlib_module_names}
    wrong = [
        f"{module} imports {name}"
        for module in MODULES
        for name in imports(module) - free
        if not name.startswith(".") and not within(module, PACKAGES.get(name, []))
    ]
    assert wrong == []


def test_results_use_only_functions_with_equal_bits_everywhere():
    """For example no logarithm of numpy, whose last bit depends on the processor."""
    wrong = {
        f"{module}: {node.value.id}.{node.attr}"
        for module in MODULES
        if not within(module, ["core", *MAY_BE_INEXACT])
        for node in ast.walk(ast.parse(MODULES[module].read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.value.id in ("np", "math") and node.attr in BY_PROCESSOR
    }
    assert wrong == set()


@pytest.mark.parametrize("module", WITHOUT)
def test_pictures_and_info_need_no_mpi(module):
    """Results can be read without MPI, also by indirect imports."""
    names = {name.removeprefix(".") for name in reached(module)}
    assert [name for name in names if within(name, WITHOUT[module])] == []


def files_of(package: str) -> list[str]:
    """Return the modules of a package, without those of its packages."""
    return [
        name for name in MODULES if name.rpartition(".")[0] == package and MODULES[name].stem != "__init__"
    ]


ALL_PACKAGES = sorted({name.rpartition(".")[0] for name in MODULES} - {""})


@pytest.mark.parametrize("package", ALL_PACKAGES)
def test_a_package_is_small_and_flat(package):
    """A package has few files, and its longest chain of imports is short."""
    files = files_of(package)
    within_room = {name: [one[1:] for one in imports(name) if one[1:] in files] for name in files}

    def floors(name: str) -> int:
        return 1 + max(map(floors, within_room[name]), default=0)

    assert len(files) <= MOST_FILES
    assert max(map(floors, files), default=0) <= LONGEST_CHAIN


def test_no_file_has_more_than_five_hundred_lines():
    """One file has one subject, mostly in 60 to 300 lines."""
    count = {str(path.relative_to(PACKAGE)): len(path.read_text().splitlines()) for path in MODULES.values()}
    assert [name for name, lines in count.items() if lines > MOST_LINES] == []
