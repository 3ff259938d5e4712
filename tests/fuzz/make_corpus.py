# SPDX-License-Identifier: Apache-2.0
"""make_corpus.py BIN CORPUS: writes the seeds of tests/corpus, small files of every kind that is read, with
DCMTK, GDCM, nibabel and Pillow (and trocar-mesh for .glb). Only needed to add kinds: the corpus is in the
repository, with earlier findings (found_*) beside the seeds."""
import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

import nibabel
import numpy as np
from PIL import Image

tests = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(tests / "support"), str(tests / "e2e"), str(tests / "pipeline" / "read" / "dicom")]
import device_link  # noqa: E402
import dicom_variants_test as dicom  # noqa: E402
import dicom_segmentation_test as segmentation  # noqa: E402

dicom.COLUMNS, dicom.ROWS, dicom.SLICES = 17, 12, 3
segmentation.WIDTH, segmentation.HEIGHT, segmentation.SLICES = 17, 12, 6


def write_dicom(folder):
    tools = {**dicom.LOSSLESS, "jpeg_baseline": ("dcmcjpeg", "+eb"), "jpeg_extended": ("dcmcjpeg", "+ee"),
             "jpeg_progressive": ("dcmcjpeg", "+ep"), "jpeg_ls_near": ("dcmcjpls", "+en"), "j2k_lossy": ("gdcmconv", "--j2k", "--lossy")}
    for name, tool in tools.items():
        bits, allocated = (8, 8) if name in ("jpeg_baseline", "jpeg_progressive") else (12, 16)
        for kind, ds in (("slice", dicom.make_slice(0, bits, False, allocated)), ("enhanced", dicom.make_enhanced(bits, False, allocated, order=(2, 0, 1)))):
            with tempfile.TemporaryDirectory() as work:
                original = pathlib.Path(work) / "original"
                ds.save_as(original, write_like_original=False)
                done = subprocess.run([*tool, original, folder / f"{kind}_{name}.dcm"], check=False, capture_output=True)
                if done.returncode:
                    print(kind, name, done.stdout[-200:], done.stderr[-200:])


def write_segmentations(folder):
    labels = segmentation.label_map()
    for name, kind, tool in (("binary", "BINARY", ("dcmconv", "+te")), ("binary_big_endian", "BINARY", ("dcmconv", "+tb")),
                             ("fractional", "FRACTIONAL", ("dcmconv", "+ti")), ("fractional_rle", "FRACTIONAL", ("dcmcrle",))):
        with tempfile.TemporaryDirectory() as work:
            original = pathlib.Path(work) / "original"
            segmentation.make_seg(labels, kind=kind).save_as(original, write_like_original=False)
            subprocess.run([*tool, original, folder / f"seg_{name}.dcm"], check=True)


def write_nifti(folder):
    z, y, x = np.mgrid[0:4, 0:9, 0:11]
    volume = (500 * np.sin(x / 2) * np.cos(y / 3) + 100 * z).T
    affine = np.array([[0, -0.5, 0, 3], [0.7, 0, 0, -2], [0, 0, 1.5, 9], [0, 0, 0, 1.0]])
    for dtype in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"):
        data = (volume % 100 if dtype in ("u1", "i1") else abs(volume) if dtype[0] == "u" else volume).astype(dtype)
        nibabel.save(nibabel.Nifti1Image(data, affine, dtype=data.dtype), folder / f"one_{dtype}.nii")
    for order in ("<", ">"):
        for kind, cls, header in (("one", nibabel.Nifti1Image, nibabel.Nifti1Header), ("two", nibabel.Nifti2Image, nibabel.Nifti2Header)):
            image = cls(volume.astype("i2"), affine, header(endianness=order))
            image.header.set_slope_inter(0.5, -3)
            image.set_qform(affine, 1)
            image.set_sform(None, 0)
            image.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"seed"))
            nibabel.save(image, folder / f"{kind}_{'big' if order == '>' else 'little'}.nii")
            nibabel.save(image, folder / f"{kind}_{'big' if order == '>' else 'little'}.nii.gz")
    nibabel.save(nibabel.Nifti1Image(volume.astype("i2"), None), folder / "no_orientation.nii")


def write_interlaced(image, file):
    """A palette image of 4 bits, interlaced by Adam7, which Pillow cannot write."""
    indices, palette = np.asarray(image), bytes(image.getpalette()[:48])
    rows = b""
    for x0, y0, dx, dy in ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)):
        for row in indices[y0::dy, x0::dx]:
            even = np.append(row, [0] * (len(row) % 2)).astype("u1")
            rows += b"\0" + bytes(even[0::2] << 4 | even[1::2])
    head = struct.pack(">IIBBBBB", indices.shape[1], indices.shape[0], 4, 3, 0, 0, 1)
    chunks = ((b"IHDR", head), (b"PLTE", palette), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""))
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks))


def write_images(folder):
    y, x = np.mgrid[0:14, 0:19]
    grey = ((np.sin(x / 3) * np.cos(y / 4) + 1) * 127).astype("u1")
    colour = np.stack([grey, 255 - grey, grey // 2], -1)
    images = {"grey": Image.fromarray(grey), "colour": Image.fromarray(colour), "alpha": Image.fromarray(np.dstack([colour, grey])),
              "bits": Image.fromarray(grey > 90), "deep": Image.fromarray(grey.astype("u2") * 257), "palette": Image.fromarray(colour).quantize(16),
              "grey_alpha": Image.fromarray(np.dstack([grey, grey]), "LA")}
    for name, image in images.items():
        image.save(folder / f"{name}.png")
        if name not in ("grey_alpha",):
            for compression in ("raw", "tiff_lzw", "tiff_deflate", "packbits") + (("jpeg",) if name in ("grey", "colour") else ()):
                image.save(folder / f"{name}_{compression}.tif", compression=compression)
        if name not in ("deep", "grey_alpha"):
            image.save(folder / f"{name}.bmp")
    write_interlaced(images["palette"], folder / "palette_interlaced.png")
    for name in ("grey", "colour"):
        images[name].save(folder / f"{name}.jpg")
        images[name].save(folder / f"{name}_progressive.jpg", progressive=True)


def write_assets(folder, mesh):
    with tempfile.TemporaryDirectory() as work:
        scan = pathlib.Path(work) / "scan.nii"
        z, y, x = np.mgrid[0:3, 0:24, 0:20]
        volume = 100 - 15 * np.hypot(x - 10, y - 12) + 40 * (np.hypot(x - 10, y - 12) < 2) * -5 + 0 * z
        nibabel.save(nibabel.Nifti1Image(volume.T.astype("i2"), np.eye(4)), scan)
        for name, options in (("coarse", ["--min-angle", "0", "--tolerance", "1"]), ("fine", ["--tolerance", "0.1"])):
            subprocess.run([mesh, scan, "-o", folder / f"{name}.glb", "--quiet", "--threshold", "0", *options], check=True)
        volume[1] = -1000  # a slice without material
        nibabel.save(nibabel.Nifti1Image(volume.T.astype("i2"), np.eye(4)), scan)
        subprocess.run([mesh, scan, "-o", folder / "indexed.glb", "--quiet", "--min-angle", "0", "--tolerance", "1", "--threshold", "0"], check=True)


def write_packets(folder):
    """The valid packets of fuzz_packet.cpp, made independently."""
    key = bytes((7 * i + 1) % 256 for i in range(32))
    host, drive = bytes([1, 2, 3] + 13 * [0]), bytes([4, 5, 6] + 13 * [0])
    session, of_session = int.from_bytes(drive[:8], "little"), device_link.session_key(key, host, drive)
    torques, angles = [0.25 * i - 1 for i in range(8)], [0.125 * i - 1 for i in range(16)]
    packets = {
        "hello": device_link.hello(key, host, 1e-3, True, 1000),
        "welcome": device_link.welcome(key, host, drive, 2.5e-4, 1, 2000),
        "command": device_link.command(of_session, session, 1, device_link.TORQUE, torques, 1, 3000),
        "state": device_link.state(of_session, session, 1, device_link.TORQUE_ON, 0, 1, angles, 4000),
        "hello_pose": device_link.hello(key, host, 1e-3, True, 1000, device_link.POSE),
        "wrench_command": device_link.wrench_command(of_session, session, 1, device_link.TORQUE, torques[:6], 1, 3000),
        "pose_state": device_link.pose_state(of_session, session, 1, device_link.TORQUE_ON, 0, 6, 1, angles[:3], (0.6, -0.8, 0, 0), 4000),
    }
    for name, data in packets.items():
        (folder / f"{name}.bin").write_bytes(data)


def write_streams(folder):
    """Operations of fuzz_stream.cpp: hello 0, command 1 (host, how, torque), repeat 3 (which), change 4 (which, where, how, bit),
    forge 5 (size, bytes), wait 6 (periods), delay 7 (tenths of a second). First byte: 0 real clock, 1 lock-step."""
    hello, torque, stop, hold, late = [0, 1, 2, 0], [1, 0, 0, 50], [1, 0, 15], [1, 0, 14], [1, 0, 5, 90]
    wait, again, newest = [6, 3], [3, 1], [3, 2]
    streams = {
        "session": hello + (torque + wait) * 3 + stop + wait,
        "silence_trips_the_watchdog": hello + torque + wait * 5 + torque + wait,
        "repeated_command": hello + torque + again * 3 + wait + again,
        "overtaken_command": hello + torque + late + torque + newest + wait,
        "repeated_hello": hello + [3, 0] * 5 + torque + wait,
        "two_hosts": hello + [0, 9, 9, 1] + torque + wait + [1, 1, 0, 20] + wait * 4 + [1, 1, 0, 20] + wait,
        "changed_command": hello + torque + [4, 1, 60, 0, 3, 4, 1, 140, 0, 7, 4, 1, 100, 1, 4, 1, 3, 2, 9] + wait,
        "invented": hello + [5, 8, 84, 82, 67, 82, 1, 3, 144, 0] + torque + wait,
        "old_session_after_stop": hello + torque + stop + again + wait + hello + [3, 1, 3, 2] + torque + wait,
        "taken_over_after_silence": hello + torque + [7, 5] + hello + torque + [3, 1] + wait,
        "sequence_gap": hello + [1, 0, 7, 10] + torque + [1, 0, 11, 10] + wait,
        "hold_and_torque": hello + hold + wait + torque + wait + hold + wait,
    }
    for name, operations in streams.items():
        for first, clock in ((0, "real"), (1, "lock_step")):
            (folder / f"{name}_{clock}.bin").write_bytes(bytes([first] + operations))


def write_raw_outlines(folder):
    """Bytes that fuzz_pslg.cpp decodes as rings or pixels: angle, area, tolerance, kind 0 rings, 1 mask, 2 chains, 3 grey."""
    rng = np.random.default_rng(5)
    blob = (np.hypot(*np.mgrid[-8:8, -8:8]) < 6.5).astype("u1")
    noise = rng.integers(0, 2, (16, 16), "u1")
    for name, picture in (("blob", blob), ("noise", noise)):
        bits = np.packbits(picture.ravel(), bitorder="little").tobytes()
        for kind, what in ((1, "mask"), (2, "chains")):
            (folder / f"bytes_{name}_{what}.bin").write_bytes(bytes([30, 8, 2, kind, 15, 15]) + bits)
        grey = (picture * 50 + rng.integers(0, 60, (16, 16))).astype("u1").tobytes()
        (folder / f"bytes_{name}_grey.bin").write_bytes(bytes([20, 4, 1, 3, 15, 15]) + grey)
    square, hole = [100, 156, 100, 100, 156, 100, 156, 156], [236, 236, 236, 20, 20, 20, 20, 236]
    for scale in range(4):
        (folder / f"bytes_rings_{scale}.bin").write_bytes(bytes([30, 12, 0, 0, scale, 0, 1, *square[2:], *square[:2], 1, 1, *hole]))


def write_raw_cuts(folder):
    """Bytes that fuzz_cut.cpp decodes as a square sheet (cells, cell, scale) and tools (place, corners - 3, corners)."""
    hexagon = [3, 100, 0, 50, 87, 206, 87, 156, 0, 206, 169, 50, 169]
    for cells in (0, 3, 7):
        for scale in (0, 9, 39):
            tools = [byte for at in ((0, 0), (10, 3), (246, 20), (60, 60)) for byte in (*at, *hexagon)]
            (folder / f"bytes_{cells + 1}_cells_{scale}.bin").write_bytes(bytes([cells, 40, scale] + tools))


def write_raw_devices(folder):
    """Bytes that fuzz_device.cpp decodes as a kind and its doubles, little endian."""
    nan, inf, tiny = float("nan"), float("inf"), 5e-324
    middle, quaternion = [0.0, 0.0, 0.15], [0.0, 0.0, 0.0, 1.0]
    wrench, limits = [1.0, 2.0, 10.0, 0.1, 0.2, 0.3], [6.0] * 8
    angles = [4.2, -1.1, 0.0, -0.6] * 4  # about the middle pose's
    keyframes = [0.0, *middle, *quaternion, 1.0, 0.0, 0.0, 0.1, *quaternion]
    hand = [4000.0, 100.0, 20.0, 0.3, 0.05, inf]
    quiet = [0.0, 1e-3, 5000.0, 0.0]  # angle (of no encoder), gap, stiffness, offset
    cases = {
        "pose": ([0], middle + quaternion + wrench + limits),
        "pose_nan": ([0], [0.0, nan, 0.15] + quaternion + wrench + limits),
        "pose_denormal": ([0], [tiny, -tiny, 0.15] + quaternion + [tiny] * 6 + [tiny] * 8),
        "pose_at_the_edge": ([0], [0.0, 0.0, 0.2299] + quaternion + wrench + limits),
        "turned": ([1], middle + [0.1, -0.05, 0.0] + wrench + limits),
        "turned_to_the_singularity": ([1], middle + [0.0, 0.0, 0.5927] + wrench + limits),
        "turned_and_scaled": ([1], [0.01, -0.01, 0.16, 0.0, 0.1, 0.05, 0.0, 0.0, 500.0, 0.0, 0.0, 0.0] + limits),
        "encoders": ([2], angles),
        "encoders_wrapped": ([2], [angles[0] + 2 * np.pi] + angles[1:]),
        "encoders_inf": ([2], angles[:5] + [-inf] + angles[6:]),
        "currents": ([3], [1.0, 0.0, nan, inf, -inf, 1e300, tiny, -3.0]),
        "hand": ([4, 2], keyframes + hand),
        "hand_nan": ([4, 2], keyframes + hand[:4] + [nan, nan]),
        "packet_inf": ([6], [inf]),
    }
    for which in (0, 3, 9, 20, 30):
        cases[f"description_{which}"] = ([5, which], [0.1])
    for name, (kind, numbers) in cases.items():
        (folder / f"bytes_{name}.bin").write_bytes(bytes(kind) + struct.pack(f"<{len(numbers)}d", *numbers))
    # The loop: limits (how many; which, to what), then ticks (encoder, 16 to 18 for other inputs, or none, angle, gap, stiffness, offset).
    ticks = {"quiet": [(31, *quiet)] * 3, "jump": [(31, *quiet), (4, 1.0, *quiet[1:])], "nan": [(2, nan, *quiet[1:])],
             "stiff": [(31, 0.0, 1e-3, 1e300, 0.0)] * 4, "gap": [(31, 0.0, inf, 5000.0, 0.0)]}
    for name, each in ticks.items():
        data = b"".join(bytes([tick[0]]) + struct.pack("<4d", *tick[1:]) for tick in each)
        (folder / f"bytes_loop_{name}.bin").write_bytes(bytes([7, 0]) + data)
        (folder / f"bytes_loop_{name}_limited.bin").write_bytes(bytes([7, 2, 10]) + struct.pack("<d", 0.0) + bytes([4]) + struct.pack("<d", inf) + data)


def main():
    programs, corpus = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    folders = {}
    for kind in ("dicom", "nifti", "image", "glb", "packet", "stream", "pslg", "cut", "device"):
        folders[kind] = corpus / kind
        folders[kind].mkdir(parents=True, exist_ok=True)
    write_dicom(folders["dicom"])
    write_segmentations(folders["dicom"])
    write_nifti(folders["nifti"])
    write_images(folders["image"])
    write_packets(folders["packet"])
    write_streams(folders["stream"])
    write_raw_outlines(folders["pslg"])
    write_raw_cuts(folders["cut"])
    write_raw_devices(folders["device"])
    write_assets(folders["glb"], programs / "trocar-mesh")


main()
