"""reports/benchmarks.md has one section per script; each script replaces its own."""

import re
from pathlib import Path

REPORT = Path(__file__).resolve().parent.parent / "reports/benchmarks.md"
HEAD = (
    "# Benchmarks\n\n"
    "Ratios hold within one run on one machine; seconds do not carry over. Every section names the script that makes\n"
    "it, which says what is measured and how.\n"
)


def put(name, lines):
    """Writes the section of the script `name`, leaving those of other scripts as they are."""
    text = REPORT.read_text() if REPORT.exists() else HEAD
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    section = "\n".join([begin, "", *lines, "", end])
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.S)
    if pattern.search(text):
        text = pattern.sub(lambda _: section, text)
    else:
        text = text.rstrip("\n") + "\n\n" + section + "\n"
    REPORT.write_text(text)
    print("\n".join(lines))
