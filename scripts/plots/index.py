# SPDX-License-Identifier: Apache-2.0
"""index.py FOLDER: FOLDER/index.html, a page of the folder's pictures with their captions, in the order of captions.py."""
import html
import os
import pathlib
import sys

from captions import CAPTIONS
from PIL import Image

STYLE = """body { font: 15px/1.5 "DejaVu Sans", Verdana, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1em }
img { max-width: 100%; height: auto } figure { margin: 2.5em 0 } figcaption { color: #444 }"""


def main():
    folder = pathlib.Path(sys.argv[1])
    figures = []
    for name in CAPTIONS:
        picture = folder / f"{name}.png"
        if not picture.exists():
            continue
        with Image.open(picture) as image:
            image.load()
            caption, drawn = image.text["Description"], image.text["Comment"] == "caption drawn"
        figures.append(f"<figure id={name}><a href={name}.png><img src={name}.png alt=\"{html.escape(caption)}\"></a>"
                       f"<figcaption><b>{name}.png</b>{'' if drawn else ' ' + html.escape(caption)}</figcaption></figure>")
    page = folder / "index.html"
    temporary = page.with_name(f".{page.name}.{os.getpid()}")
    temporary.write_text("<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8><title>Trocar: pictures of the demo</title>"
                         f"<style>{STYLE}</style></head><body><h1>Pictures of the demo</h1>\n" + "\n".join(figures) + "\n</body></html>\n",
                         encoding="utf-8")
    os.replace(temporary, page)
    print(page)


if __name__ == "__main__":
    main()
