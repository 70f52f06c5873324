"""Optional packages, absent on compute nodes, and the extra of netfall that installs each."""

from collections.abc import Iterator
from contextlib import contextmanager

from netfall.core import messages
from netfall.core.errors import InputError

EXTRAS = {
    "plot": ("matplotlib", "mpl_toolkits", "PIL", "adjustText", "imageio_ffmpeg", "markdown_it"),
    "cad": ("ezdxf", "vtkmodules"),
    "view": ("k3d",),
    "study": ("openturns",),
}
EXTRA_OF_PACKAGE = {package: extra for extra, packages in EXTRAS.items() for package in packages}


@contextmanager
def naming_extras() -> Iterator[None]:
    """Name the extra to install if one of its packages is missing. Raises InputError."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRA_OF_PACKAGE:
            raise
        raise InputError(
            messages.MISSING_PACKAGE(package=package, extra=EXTRA_OF_PACKAGE[package])
        ) from error
