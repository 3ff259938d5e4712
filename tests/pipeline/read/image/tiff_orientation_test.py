# SPDX-License-Identifier: Apache-2.0
"""TIFFs whose Orientation tag says that their first row is at the bottom, or their first column at the right, are the same picture as an
upright one, with 8 and with 16 bits and as labels. TIFFs whose rows are columns of the picture are refused."""
import numpy as np
from mesh_runs import dump
from PIL import Image

ORIENTATION = 274
UPRIGHT = {1: lambda a: a, 2: np.fliplr, 3: lambda a: np.flipud(np.fliplr(a)), 4: np.flipud}
SHAPE = (14, 19)


def test_orientations(programs, work):
    rng = np.random.default_rng(4)
    pictures = {"grey_8": rng.integers(0, 256, SHAPE).astype(np.uint8), "grey_16": rng.integers(0, 65536, SHAPE).astype(np.uint16),
                "palette": rng.integers(0, 9, SHAPE).astype(np.uint8)}
    for name, picture in pictures.items():
        axis, seen = "labels" if name == "palette" else "transverse", {}
        for tag in range(1, 9):
            stored = Image.fromarray(np.ascontiguousarray(UPRIGHT[tag](picture) if tag in UPRIGHT else picture))
            if name == "palette":
                stored = stored.convert("P")
            file = work / f"{name}_{tag}.tif"
            stored.save(file, tiffinfo={ORIENTATION: tag})
            with Image.open(file) as back:
                assert back.tag_v2[ORIENTATION] == tag
            code, said, seen[tag] = dump(programs, work / "values", axis, "1,1,1", file)
            if tag in UPRIGHT:
                assert code == 0, f"{file.name}: {said}"
                assert np.array_equal(seen[tag], seen[1]), f"{file.name}: not upright"
            else:
                assert code == 3 and f"(Orientation {tag})" in said and "\n" not in said, f"{file.name}: {said}"
        assert len(np.unique(seen[1])) > 5, f"{name}: an empty picture"
