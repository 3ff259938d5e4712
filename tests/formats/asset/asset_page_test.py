# SPDX-License-Identifier: Apache-2.0
"""Reads assets as formats/asset/asset.md says and by
nothing else: container, JSON, slice index with its checksums, outlines, what of Draco's payload the
page describes. The page's examples must be the bytes of the files that they name.
"""
import json
import re
import struct
import zlib

from programs import ASSETS


class Broken(Exception):
    pass


def require(condition, what):
    if not condition:
        raise Broken(what)


def container(glb):
    """The JSON text and the binary data."""
    require(len(glb) >= 28, "too short")
    magic, version, size, json_bytes, json_type = struct.unpack("<4sIII4s", glb[:20])
    require((magic, version, size, json_type) == (b"glTF", 2, len(glb), b"JSON"), "header")
    text = glb[20:20 + json_bytes]
    binary_bytes, binary_type = struct.unpack("<I4s", glb[20 + json_bytes:28 + json_bytes])
    binary = glb[28 + json_bytes:]
    require(binary_type == b"BIN\0" and len(binary) == binary_bytes, "binary chunk")
    return text, binary


def varint(data, at):
    value, shift = 0, 0
    while True:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return value, at


def lattice(values, bits):
    scaled = [v * 2**bits for v in values]
    require(all(v == int(v) and abs(v) < 2**24 for v in scaled), "off the lattice")
    return [int(v) for v in scaled]


def rings_of(positions, indices, index_bytes, bits):
    """The outline's rings as lists of lattice points."""
    xyz = [v for (v,) in struct.iter_unpack("<f", positions)]
    require(all(z == 0 for z in xyz[2::3]), "outline out of its plane")
    points = list(zip(lattice(xyz[0::3], bits), lattice(xyz[1::3], bits)))
    flat = [i for (i,) in struct.iter_unpack("<H" if index_bytes == 2 else "<I", indices)]
    rings, first = [], 0
    for i, (start, end) in enumerate(zip(flat[0::2], flat[1::2])):
        require(start == i and end in (i + 1, first), "segments are not rings")
        if end == first:
            require(i - first >= 2, "a ring of fewer than 3 vertices")
            rings.append(points[first:i + 1])
            first = i + 1
    require(first == len(points), "a ring is not closed")
    return rings


def doubled_area(ring):
    return sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(ring, ring[1:] + ring[:1]))


def colour_table(page):
    """The rows of the page's table of colours: nine values each of HU, red, green and blue."""
    rows = re.findall(r"^\| (HU|red|green|blue) ((?:\| -?\d+ ){9})\|", page, re.MULTILINE)
    return {name: [int(v) for v in row.split("|")[1:]] for name, row in rows}


def check_payload(draco, document, primitive, accessors):
    """What the page says of a payload beside its vertices."""
    position, corners = accessors[primitive["attributes"]["POSITION"]], accessors[primitive["indices"]]
    require("bufferView" not in position and "bufferView" not in corners, "Draco's accessors")
    require((position["componentType"], position["type"]) == (5126, "VEC3"), "position accessor")
    require((corners["componentType"], corners["type"]) == (5125, "SCALAR"), "index accessor")
    (x0, y0, z), (x1, y1, z1) = position["min"], position["max"]
    require(all(isinstance(v, int) for v in (x0, y0, z, x1, y1)) and z == z1, "bounds")
    require(draco[:11] == b"DRACO\2\2\1\1\0\0", "Draco's header")
    stated_vertices, after = varint(draco, 12)
    stated_triangles, _ = varint(draco, after)
    require(3 * stated_triangles == corners["count"] and stated_vertices <= position["count"], "Draco's counts")
    ids = {"POSITION": 0}
    for name, number, kind, normalized in (("_HU", 1, (5122, "SCALAR"), False), ("COLOR_0", 2, (5121, "VEC3"), True)):
        if name in primitive["attributes"]:
            ids[name] = number
            accessor = accessors[primitive["attributes"][name]]
            require((accessor["componentType"], accessor["type"]) == kind, f"accessor of {name}")
            require(accessor.get("normalized", False) == normalized and accessor["count"] == position["count"],
                    f"accessor of {name}")
    if "_HU" in ids:
        require(document["extras"]["trocar"]["hu_step"] == 8, "hu_step")
    ox, oy, oz, extent, n = struct.unpack("<4fB", draco[-17:])
    require(ox <= x0 and oy <= y0 and oz == z and extent == 2**n - 1, "quantisation of the position")
    require(primitive["extensions"]["KHR_draco_mesh_compression"]["attributes"] == ids, "Draco's attributes")
    return z


def check_lines(binary, document, primitive, z):
    """Lines are rings, each from its smallest vertex, and rings ascend."""
    def data(accessor):
        view = document["bufferViews"][accessor["bufferView"]]
        require(view["byteOffset"] % 4 == 0, "alignment of lines")
        return binary[view["byteOffset"]:view["byteOffset"] + view["byteLength"]]

    position, corners = (document["accessors"][n] for n in (primitive["attributes"]["POSITION"], primitive["indices"]))
    positions = data(position)
    require(all(v == z for (v,) in struct.iter_unpack("<8xf", positions)), "z of the lines")
    flat = b"".join(positions[at:at + 8] + bytes(4) for at in range(0, len(positions), 12))
    rings = rings_of(flat, data(corners), {5123: 2, 5125: 4}[corners["componentType"]], 0)
    require(rings == sorted(rings) and all(ring[0] == min(ring) for ring in rings), "order of the lines")


def entries_of(document):
    """(index, node, triangles primitive or None, lines or None, mean HU or None) of each entry."""
    expected = 0
    for number in document["nodes"][2].get("children", []):
        node = document["nodes"][number]
        said = node.get("extras", {}).get("trocar", {})
        primitives = document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else [None]
        pairs = []
        for primitive in primitives:
            if primitive is not None and primitive.get("mode", 4) == 1:
                pairs[-1][1] = primitive
            else:
                pairs.append([primitive, None])
        means = said.get("mean_hu", [None] * len(pairs))
        require(len(pairs) <= 32 and len(means) == len(pairs), "entries of a node")
        require("index" in said or "mean_hu" not in said or len(means) == 1, "index beside mean_hu")
        expected = said.get("index", expected)
        for (primitive, lines), mean in zip(pairs, means):
            yield expected, node, primitive, lines, mean
            expected += 1


def check_contents(text, binary):
    """A file by its JSON and by its index; gives the number of slices."""
    document = json.loads(text)
    head, nodes, accessors = document["extras"]["trocar"], document["nodes"], document["accessors"]
    require(0 <= head["lattice_bits"] <= 14, "lattice_bits")
    require(head["use"] == "for training, not for planning" and head["materials"], "extras.trocar")
    require((nodes[0]["children"], nodes[1]["children"]) == ([1], [2]), "top nodes")
    entries = list(entries_of(document))
    magic, version, count, json_bytes, binary_bytes, extras_at, extras_bytes, checksum, first, last, frame_at, frame_bytes = \
        struct.unpack("<8s7I2i2I", binary[:52])
    require((magic, version, count, json_bytes, binary_bytes) ==
            (b"TROCARIX", 3, len(entries), len(text), len(binary)), "index header")
    texts = text[extras_at:extras_at + extras_bytes], text[frame_at:frame_at + frame_bytes]
    require(zlib.crc32(b"".join(texts)) == checksum, "checksum of the extras")
    require(list(map(json.loads, texts)) == [document["extras"], nodes[1]], "texts of the index")
    for place, (wanted, node, primitive, lines, mean) in enumerate(entries):
        at = 52 + 24 * place
        index, node_at, node_bytes, material, draco_at, draco_bytes, checksum = \
            struct.unpack("<iIHHIII", binary[at:at + 24])
        own, draco = text[node_at:node_at + node_bytes], binary[draco_at:draco_at + draco_bytes]
        require(zlib.crc32(binary[at:at + 20] + bytes(4) + own + draco) == checksum, "checksum of an entry")
        require(json.loads(own) == node and index == wanted, "text or index of an entry")
        if mean is not None:  # as a reader of one slice finds it
            said = json.loads(own)["extras"]["trocar"]
            require(said["mean_hu"][index - said.get("index", index)] == mean, "place in mean_hu")
        if primitive is None:
            require((draco_at, draco_bytes) == (0, 0), "a slice without material")
            continue
        view = document["bufferViews"][primitive["extensions"]["KHR_draco_mesh_compression"]["bufferView"]]
        require((view["byteOffset"], view["byteLength"]) == (draco_at, draco_bytes), "buffer view")
        require(primitive["material"] == material < len(head["materials"]), "material")
        z = check_payload(draco, document, primitive, accessors)
        if lines is not None:
            check_lines(binary, document, lines, z)
    indices = [entry[0] for entry in entries]
    require(len(set(indices)) == head["slices"] and indices == sorted(indices), "slices")
    require((first, last) == ((indices[0], indices[-1]) if indices else (0, 0)), "first and last slice")
    return head["slices"]


def check_asset(glb):
    """The whole file by its JSON and by its index; gives the number of slices."""
    text, binary = container(glb)
    require(json.loads(text)["extras"]["trocar"]["schema"] == 2, "schema")
    return check_contents(text, binary)


def check_bytes(example, source):
    """The rows "OFFSET  HEX HEX ... | meaning" of a section and its JSON block; gives the file that it names."""
    glb = (source / re.search(r"`(tests/corpus/\S+\.glb)`", example)[1]).read_bytes()
    rows = re.findall(r"^ *(\d+)  ((?:[0-9a-f]{2} +)+)\|", example, re.MULTILINE)
    assert len(rows) > 10, rows
    for offset, listed in rows:
        wanted = bytes.fromhex(listed)
        found = glb[int(offset):int(offset) + len(wanted)]
        assert found == wanted, f"byte {offset}: {found.hex(' ')}, the page says {listed}"
    text, _ = container(glb)
    assert re.search(r"```json\n(.*)\n```", example)[1].encode() in text, "extras of the example"
    return glb


def check_examples(page, source):
    """The section "Example"; gives the file that it names."""
    glb = check_bytes(page.split("\n## Example\n")[1].split("\n## ")[0], source)
    document = json.loads(container(glb)[0])
    entries = list(entries_of(document))
    assert [entry[0] for entry in entries] == [0, 1, 2, 3] and entries[2][2] is None, entries
    _, node, primitive, _, _ = entries[1]
    position = document["accessors"][primitive["attributes"]["POSITION"]]
    assert node == document["nodes"][3] == {"mesh": 0} and position["min"][2] == 384, node
    lps = [a + b for a, b in zip((760, 2048, 384), document["nodes"][1]["translation"])]
    assert lps == [-4104, -3840, -2688], lps
    m = document["nodes"][0]["matrix"]
    metres = [sum(m[4 * i + k] * lps[i] for i in range(3)) for k in range(3)]
    assert max(abs(a - b) for a, b in zip(metres, (-0.01603125, -0.0105, 0.015))) < 1e-15, metres

    colours = colour_table(page)
    assert colours["HU"] == [-200 + 256 * i for i in range(9)] and len(colours) == 4, colours
    code = (source / "formats/asset/draco_mesh.cpp").read_text(encoding="utf-8")
    listed = re.findall(r"\{(\d+), (\d+), (\d+)\}", code.split("kColours{{")[1].split("}}};")[0] + "}")
    assert [tuple(map(int, row)) for row in listed] == list(zip(*(colours[c] for c in ("red", "green", "blue")))), listed
    return glb


def changes_are_found(glb):
    """A changed byte of the example's extras, of the node of slice 0, of its record or of its payload is found."""
    text, binary = container(glb)
    extras_at, = struct.unpack("<I", binary[24:28])
    _, node_at, _, _, draco_at, _, _ = struct.unpack("<iIHHIII", binary[52:76])
    data = 28 + len(text)
    for offset in (20 + extras_at + 30, 20 + node_at + 10, data + 52 + 4, data + draco_at + 30, data + draco_at + 60):
        changed = bytearray(glb)
        changed[offset] ^= 1
        try:
            check_asset(bytes(changed))
        except (Broken, ValueError, KeyError, IndexError):
            continue
        raise AssertionError(f"a change of byte {offset} was not found")


def test_asset_page(source):
    page = (source / "formats/asset/asset.md").read_text(encoding="utf-8")
    changes_are_found(check_examples(page, source))
    corpus = source / "tests/corpus/glb"
    ours = ("schema_2", "coloured", "mean_hu")
    for file in [*(corpus / f"{name}.glb" for name in ours), ASSETS / "sample.glb"]:
        print(f"{file}: {check_asset(file.read_bytes())} slices")
