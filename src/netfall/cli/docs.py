"""The command that prints the documentation."""

from netfall.cli.options import command, option
from netfall.core.progress import print_lines


@command(
    option(
        "topic", "TOPIC", "page, key, column, dataset, command or message code", default="pages", nargs="?"
    )
)
def docs(topic: str) -> None:
    """Print a page of the documentation, or an entry of the reference; "pages" lists the pages.

    examples:
      netfall docs wind.speed
      netfall docs how-to/snow
    """
    from netfall.docs.topics import find

    print_lines(find(topic))
