# SPDX-License-Identifier: Apache-2.0
"""The files of `trocar-mesh export`: all of them are written, or the folder stays as it was."""
from mesh_program_e2e_test import refuses
from programs import run


def test_export_complete_and_of_one_asset(programs, scan, work):
    """An export writes all files of one asset or none."""
    mesh, folder = programs / "trocar-mesh", work / "exported"
    for name, slices in (("few", "3:4"), ("more", "3:6"), ("one", "5:5")):
        run(mesh, scan / "sample.nii.gz", "-o", work / f"{name}.glb", "--slices", slices, "--quiet")
    run(mesh, "export", work / "few.glb", "-o", folder)
    run(mesh, "export", work / "few.glb", "-o", folder)
    (folder / "notes.txt").write_text("the user's own")
    run(mesh, "export", work / "more.glb", "-o", folder)
    there = {f.name: f.read_bytes() for f in folder.iterdir()}
    assert len(there) == 4 * 3 + 1, f"exported: {sorted(there)}"
    done = run(mesh, "export", work / "one.glb", "-o", folder)
    assert "still holds slice_0003.obj and 8 more files of another export" in done.stderr, f"exported over another: {done.stderr!r}"
    there = {f.name: f.read_bytes() for f in folder.iterdir()}
    biggest = max(len(content) for content in there.values())
    refuses(4, "File too large", "prlimit", f"--fsize={biggest - 1}", mesh, "export", work / "more.glb", "-o", folder)
    assert {f.name: f.read_bytes() for f in folder.iterdir()} == there, "a failed export left traces"
    refuses(4, "File too large", "prlimit", f"--fsize={biggest - 1}", mesh, "export", work / "more.glb", "-o", work / "new")
    assert not (work / "new").exists(), "a failed export left a folder"
    # The last file cannot be moved to its place after those before it have replaced others.
    blocked = folder / "slice_0006.svg"
    blocked.unlink()
    blocked.mkdir()
    (folder / "slice_0004.obj").unlink()
    (folder / "slice_0003.obj").write_text("the user's own")
    there = {f.name: f.read_bytes() for f in folder.iterdir() if f.is_file()}
    refuses(4, "Is a directory", mesh, "export", work / "more.glb", "-o", folder)
    assert {f.name: f.read_bytes() for f in folder.iterdir() if f.is_file()} == there, "a failed export replaced some files"
    assert [f for f in folder.iterdir() if f.is_dir()] == [blocked], "a failed export left or removed a folder"
