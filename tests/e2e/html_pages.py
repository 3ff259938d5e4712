# SPDX-License-Identifier: Apache-2.0
"""Pages that the programs write, as a browser shows them: each is a template whose script renders the JSON document embedded in it."""
import html.parser
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile

CHROMIUM = os.environ.get("TROCAR_CHROMIUM") or shutil.which("chromium")


def embedded_json(text, element_id):
    """The document in the page's JSON script element."""
    return json.loads(re.search(rf'<script type="application/json" id="{element_id}">(.*?)</script>', text, re.S)[1])


def check_self_contained(name, text):
    """The page refers to no other file and no network, and its policy forbids both."""
    assert not re.search(r"https?:(?!//www\.w3\.org/2000/svg)|(src|href)=\"(?!data:|#)|url\((?!#)|@import", text), f"{name}: the page refers to other files"
    assert "default-src 'none'" in text, f"{name}: the page has no content security policy"


def rendered(file):
    """The page's HTML once its script has run, or None where no browser is installed (an error if TROCAR_REQUIRE_CONSOLE is set)."""
    if not CHROMIUM:
        print("chromium is missing: the rendered page is not checked")
        assert not os.environ.get("TROCAR_REQUIRE_CONSOLE"), "chromium is missing"
        return None
    with tempfile.TemporaryDirectory() as profile:
        return subprocess.run([CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}", "--dump-dom",
                               pathlib.Path(file).resolve().as_uri()],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=True, timeout=300).stdout


class _Texts(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.hidden, self.texts = 0, []

    def handle_starttag(self, tag, attrs):
        self.hidden += tag in ("script", "style")

    def handle_endtag(self, tag):
        self.hidden -= tag in ("script", "style")

    def handle_data(self, data):
        if not self.hidden and data.strip():
            self.texts.append(data.strip())


def texts_of(page):
    """The texts that the reader of a rendered page sees, in order."""
    parser = _Texts()
    parser.feed(page)
    return parser.texts
