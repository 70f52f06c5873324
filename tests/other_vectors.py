"""netfall with vectors of another width and chunks of another size, in a separate process and cache."""

import sys

from netfall.core.vectors import LANES

OTHER_LANES = 12 - LANES  # 4 or 8, whichever this processor does not use
SETTING = """
import sys
from netfall.core.cache import set_cache_folder
set_cache_folder()
import netfall.core.vectors
netfall.core.vectors.LANES = {lanes}
import netfall.explicit.plan
netfall.explicit.plan.CHUNK = {chunk}
from netfall.__main__ import main
"""


def python_with(lanes: int, chunk: int, text: str = "main()") -> list[str]:
    """Return the start of a command line that runs a text, netfall by default, after the choice of both."""
    return [sys.executable, "-c", SETTING.format(lanes=lanes, chunk=chunk) + text]
