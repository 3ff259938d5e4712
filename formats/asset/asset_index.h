// SPDX-License-Identifier: Apache-2.0
// The slice index of an asset: where in the file each slice's bytes are, so that a reader takes the
// slices of a scene and nothing else. Internal to formats/.
//
// It is the first buffer view of the binary chunk (so glTF readers, to which an unused view is
// nothing, need not know of it, and rewriting tools keep or drop it as data): a header, then one
// record a slice, all of fixed size. A reader gets to any slice by a few short reads: the file's
// first 20 bytes say where the binary chunk begins, its header how many records there are, and
// slices ascend. Records hold offsets and counts only; names, matrices and measures stay in the
// JSON, of which a record names the node's own text. A chunk of its own behind the binary one would
// do as well by glTF's rules, but validators warn of it and tools that rewrite a file drop it.
//
// Laws (tests/formats/asset/asset_part_test.cpp):
//  1. An index whose header does not state the file's own chunk sizes is none: it is left over
//     from before some other tool rewrote the file. So is one of another version.
//  2. Where there is one, decode_asset() refuses the file unless every record and every text that
//     it points to agrees with the JSON. So what was verified is what a part of it gives.
//  3. Nothing that a record says is believed before it is held against the chunks' sizes.
//  4. A checksum (CRC-32) covers all bytes that a slice is made of: one that changed on its way is
//     refused, also where it would still decode.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/geometry/lattice.h"
#include "formats/base/result.h"

namespace trocar {

/// Bytes before the JSON text.
inline constexpr std::size_t kGlbHeader = 20;
/// Bytes before a further chunk's data.
inline constexpr std::size_t kGlbChunkHeader = 8;
/// The size of a .glb's JSON chunk. Refused (without a name) if it is no binary glTF, or its sizes
/// are not the file's.
Result<std::uint32_t> json_bytes_of(ByteSource& source);

inline constexpr std::array<char, 8> kIndexMagic{'T', 'R', 'O', 'C', 'A', 'R', 'I', 'X'};
inline constexpr std::uint32_t kIndexVersion = 2;
inline constexpr std::size_t kMaxSlices = 100'000;

// Bytes as they stand in the file, little-endian.

struct IndexHeader {
  std::array<char, 8> magic = kIndexMagic;
  std::uint32_t version = kIndexVersion;
  std::uint32_t slices = 0;
  std::uint32_t json_bytes = 0, binary_bytes = 0;     ///< the chunks' sizes
  std::uint32_t extras_offset = 0, extras_bytes = 0;  ///< text of the extras, in the JSON
  std::uint32_t extras_checksum = 0;
  std::int32_t first_index = 0, last_index = 0;  ///< of the first and last record; 0 if none
};

/// What of a slice stands where. Offsets of bytes are from the start of the binary chunk's data.
/// Those of the geometry are 0 if the slice has no material.
struct SliceRecord {
  std::int32_t index = 0;                         ///< AssetSlice::index
  std::uint32_t node_offset = 0, node_bytes = 0;  ///< text of its node, in the JSON
  std::uint32_t draco_offset = 0, draco_bytes = 0;
  std::uint32_t vertices = 0, triangles = 0;
  LatticePoint low, high;                                      ///< box of the vertices
  std::uint32_t outline_offset = 0, outline_vertices = 0;      ///< 12 bytes each
  std::uint32_t segments_offset = 0, segment_index_bytes = 0;  ///< one index: 2 or 4
  std::uint32_t checksum = 0;  ///< of this record without it, the node's text, and the geometry
  friend bool operator==(const SliceRecord&, const SliceRecord&) = default;

  std::uint64_t outline_bytes() const { return std::uint64_t{12} * outline_vertices; }
  std::uint64_t segments_bytes() const {
    return std::uint64_t{2} * outline_vertices * segment_index_bytes;
  }
};
static_assert(sizeof(IndexHeader) == 44 && std::is_trivially_copyable_v<IndexHeader>);
static_assert(sizeof(SliceRecord) == 64 && std::is_trivially_copyable_v<SliceRecord>);

/// A file whose index was found.
struct IndexedFile {
  IndexHeader header;
  std::uint64_t json_at = 0, binary_at = 0;  ///< where the chunks' data begin
};
/// Nothing if the file has no index (law 1). Refused as json_bytes_of().
Result<std::optional<IndexedFile>> find_index(ByteSource& source);

/// The record at a place, 0 <= place < header.slices; refused if it is not consistent (law 3).
Result<SliceRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t place);

/// The record of the slice `index`, by few reads; nothing if there is no such slice.
Result<std::optional<SliceRecord>> find_record(ByteSource& source, const IndexedFile& file,
                                               int index);

/// Bytes that a record locates.
struct SliceBytes {
  std::vector<std::uint8_t> node, draco, outline, segments;
};
/// Refused if they are not those that the record was made for (law 4).
Result<SliceBytes> read_slice_bytes(ByteSource& source, const IndexedFile& file,
                                    const SliceRecord& record);
/// Text of the document's extras, likewise.
Result<std::vector<std::uint8_t>> read_extras(ByteSource& source, const IndexedFile& file);

/// Writes the index's checksums into a .glb that has one; those of records that are not consistent
/// stay as they are.
void seal_index(std::span<std::uint8_t> glb);

}  // namespace trocar
