"""Read the tables that benchmarks print."""


def cells(text: str) -> list[list[str]]:
    """The cells of all rows of the Markdown tables in a text, headings first; lines that align columns are left out."""
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"
    ]
    return [row for row in rows if set("".join(row)) - set("-:")]
