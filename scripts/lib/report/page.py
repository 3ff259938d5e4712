# SPDX-License-Identifier: Apache-2.0
"""A self-contained HTML page: text, tables, plots as inline SVG."""
import html
import io


from style import plt

CSS = """
body { font: 15px/1.5 "DejaVu Sans", Verdana, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.7em } h2 { font-size: 1.35em; margin-top: 2.2em; border-bottom: 1px solid #ccc } h3 { font-size: 1.08em; margin-top: 1.8em }
table { border-collapse: collapse; font-size: 0.86em; margin: 0.8em 0 } td, th { padding: 0.18em 0.7em; text-align: right; border-bottom: 1px solid #e4e4e4 }
th { text-align: right; vertical-align: bottom; border-bottom: 1px solid #888; font-weight: 600 } td:first-child, th:first-child { text-align: left; white-space: nowrap }
tr.marked td { background: #fbf3da } svg { max-width: 100%; height: auto } figure { margin: 1em 0 } figcaption { color: #555; font-size: 0.9em }
.wide { overflow-x: auto } details { margin: 0.8em 0 } .verdict { background: #eef4f9; border-left: 4px solid #1f6fb4; padding: 0.5em 1em }
"""


def number(value, digits=3):
    """Readable: 3 significant digits, thousands in groups."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    if value == 0:
        return "0"
    if abs(value) >= 10 ** digits:
        return f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")
    return f"{value:.{digits}g}" if abs(value) >= 1e-4 else f"{value:.1e}"


class Page:
    def __init__(self, title):
        self.title, self.parts, self.figures = title, [], 0

    def section(self, title):
        self.parts.append(f"<h2>{html.escape(title)}</h2>")

    def heading(self, title):
        self.parts.append(f"<h3>{html.escape(title)}</h3>")

    def text_block(self, text, verdict=False):
        self.parts.append(f"<p{' class=verdict' if verdict else ''}>{html.escape(text)}</p>")

    def table(self, head, rows, marked=(), folded=None):
        """Cells: text or numbers. `marked`: indices of highlighted rows. `folded`: the heading under which the table is collapsed."""
        lines = ["<div class=wide><table><tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>"]
        for k, row in enumerate(rows):
            cells = "".join(f"<td>{html.escape(number(cell))}</td>" for cell in row)
            lines.append(f"<tr{' class=marked' if k in marked else ''}>{cells}</tr>")
        table = "\n".join(lines) + "</table></div>"
        self.parts.append(f"<details><summary>{html.escape(folded)}</summary>{table}</details>" if folded else table)

    def plot(self, figure, caption):
        """The same figure gives the same bytes; the SVG ids of different figures differ."""
        self.figures += 1
        stream = io.StringIO()
        with plt.rc_context({"svg.hashsalt": f"{self.title}/{self.figures}"}):
            figure.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
        plt.close(figure)
        svg = stream.getvalue()
        self.parts.append(f"<figure>{svg[svg.index('<svg'):]}<figcaption>{html.escape(caption)}</figcaption></figure>")

    def text(self):
        title = html.escape(self.title)
        return (f"<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8><title>{title}</title><style>{CSS}</style></head>"
                f"<body><h1>{title}</h1>\n" + "\n".join(self.parts) + "\n</body></html>\n")


