"""Tables that stand in the code as text: a row begins at the margin, its cells stand between bars."""


def rows_of(text: str) -> list[list[str]]:
    """The cells of each row; what is indented goes on with the last cell of the row above it."""
    rows: list[str] = []
    for line in filter(None, text.split("\n")):
        if line.startswith(" "):
            rows[-1] += " " + line.strip()
        else:
            rows.append(line)
    return [[cell.strip() for cell in row.split("|")] for row in rows]
