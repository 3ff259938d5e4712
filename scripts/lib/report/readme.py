# SPDX-License-Identifier: Apache-2.0
"""README.md's figures: what stands between its two marks is written by scripts/report --readme."""
import os

BEGIN, END = "<!-- report: begin -->", "<!-- report: end -->"


def update(path, sentence, parts):
    text = path.read_text(encoding="utf-8")
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"{path}: has no {BEGIN} ... {END}")
    spaced = []
    for part in parts:
        if spaced:
            spaced.append("")
        for line in part:  # a table starts after an empty line
            if line.startswith("|") and spaced and spaced[-1] and not spaced[-1].startswith("|"):
                spaced.append("")
            spaced.append(line)
    body = "\n".join([*spaced, "", f"(From `scripts/report`: {sentence}.)"])
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_text(f"{head}{begin}\n{body}\n{end}{tail}", encoding="utf-8")
    os.replace(temporary, path)
    print(path)
