"""Tables written as text in the code: a row starts at the margin, and bars separate its cells."""


def table_rows(text: str) -> list[list[str]]:
    """Return the cells of each row; an indented line continues the last cell of the row above."""
    rows: list[str] = []
    for line in filter(None, text.split("\n")):
        if line.startswith(" "):
            rows[-1] += " " + line.strip()
        else:
            rows.append(line)
    return [[cell.strip() for cell in row.split("|")] for row in rows]
