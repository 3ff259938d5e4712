// SPDX-License-Identifier: Apache-2.0
// The slice index of an asset: where in the file each slice's bytes are, so that a reader can read
// the slices of a scene and nothing else. Internal to formats/. Layout to the byte: asset.md.
//
// It is at the start of the binary chunk: a header, then one record for each entry (a slice, or a
// material of a slice), all of fixed size. A reader finds any slice with a few short reads: the
// file's first 20 bytes give the start of the binary chunk, the index header the number of records,
// and entries ascend. Records hold offsets only. Places and names stay in the JSON; a record
// locates the text of its node there. Other glTF readers ignore bytes that no buffer view covers.
// (glTF also allows a further chunk behind the binary one, but validators warn of it and tools
// that rewrite a file drop it.)
//
// Contract (tests/formats/asset/asset_part_test.cpp):
//  1. An index whose header does not state the file's own chunk sizes, or of another version,
//     counts as absent: another tool has rewritten the file since.
//  2. If there is an index, decode_asset() refuses the file unless every record and every text
//     that it points to agrees with the JSON. So reading a part gives what was verified.
//  3. Every offset and size of a record is compared with the chunks' sizes before it is used.
//  4. A checksum (CRC-32) covers all bytes of an entry: a changed byte is refused, even if the
//     slice would still decode. The lines that an asset may hold for viewers are not covered.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/result.h"
#include "formats/geometry/lattice.h"

namespace trocar {

/// Bytes before the JSON text.
inline constexpr std::size_t kGlbHeader = 20;
/// Bytes before a further chunk's data.
inline constexpr std::size_t kGlbChunkHeader = 8;
/// The size of a .glb's JSON chunk. Refused (without the file's name) if it is not binary glTF, or
/// its sizes are not the file's.
Result<std::uint32_t> json_bytes_of(ByteSource& source);

inline constexpr std::array<char, 8> kIndexMagic{'T', 'R', 'O', 'C', 'A', 'R', 'I', 'X'};
/// Of assets of schema 2; those of schema 1 have kIndexVersion1.
inline constexpr std::uint32_t kIndexVersion = 3, kIndexVersion1 = 2;
inline constexpr std::size_t kMaxSlices = 100'000;

// The bytes of the file, little-endian.

struct IndexHeader {
  std::array<char, 8> magic = kIndexMagic;
  std::uint32_t version = kIndexVersion;
  std::uint32_t entries = 0;
  std::uint32_t json_bytes = 0, binary_bytes = 0;     ///< the chunks' sizes
  std::uint32_t extras_offset = 0, extras_bytes = 0;  ///< text of the extras, in the JSON text
  std::uint32_t checksum = 0;                         ///< of these two texts
  std::int32_t first_index = 0, last_index = 0;       ///< of the first and last record; 0 if none
  std::uint32_t frame_offset = 0, frame_bytes = 0;  ///< text of the frame's node; not in version 2
};

/// Where an entry's bytes are. Offsets of the node are from the start of the JSON text, those of
/// the payload from the start of the binary chunk's data. The payload is 0, 0 if the slice has no
/// material.
struct EntryRecord {
  std::int32_t index = 0;         ///< AssetSlice::index
  std::uint32_t node_offset = 0;  ///< text of its node, in the JSON text
  std::uint16_t node_bytes = 0, material = 0;
  std::uint32_t draco_offset = 0, draco_bytes = 0;
  std::uint32_t checksum = 0;  ///< of this record without it, the node's text, and the payload
};

/// The record of a slice in schema 1.
struct SliceRecord1 {
  std::int32_t index = 0;
  std::uint32_t node_offset = 0, node_bytes = 0;
  std::uint32_t draco_offset = 0, draco_bytes = 0;
  std::uint32_t vertices = 0, triangles = 0;
  LatticePoint low, high;                                      ///< box of the vertices
  std::uint32_t outline_offset = 0, outline_vertices = 0;      ///< 12 bytes each
  std::uint32_t segments_offset = 0, segment_index_bytes = 0;  ///< of one index: 2 or 4
  std::uint32_t checksum = 0;
};
inline constexpr std::size_t kIndexHeader1Bytes = 44;  ///< without the frame
static_assert(sizeof(IndexHeader) == 52 && std::is_trivially_copyable_v<IndexHeader>);
static_assert(sizeof(EntryRecord) == 24 && std::is_trivially_copyable_v<EntryRecord>);
static_assert(sizeof(SliceRecord1) == 64 && std::is_trivially_copyable_v<SliceRecord1>);

/// A record of either schema. Counts, box and outline are unknown (0) in the index of schema 2.
struct SliceRecord : SliceRecord1 {
  std::uint16_t material = 0;

  bool is_empty() const { return draco_bytes == 0; }
  std::uint64_t outline_bytes() const { return std::uint64_t{12} * outline_vertices; }
  std::uint64_t segments_bytes() const {
    return std::uint64_t{2} * outline_vertices * segment_index_bytes;
  }
};

/// A file whose index was found.
struct IndexedFile {
  IndexHeader header;
  std::uint64_t json_at = 0, binary_at = 0;  ///< where the chunks' data begin

  bool is_schema_1() const { return header.version == kIndexVersion1; }
  std::uint64_t header_bytes() const {
    return is_schema_1() ? kIndexHeader1Bytes : sizeof(IndexHeader);
  }
  std::uint64_t record_bytes() const {
    return is_schema_1() ? sizeof(SliceRecord1) : sizeof(EntryRecord);
  }
  std::uint64_t bytes() const { return header_bytes() + header.entries * record_bytes(); }
};
/// Nothing if the file has no index (contract 1). Refused as json_bytes_of().
Result<std::optional<IndexedFile>> find_index(ByteSource& source);

/// The record at a place, 0 <= place < header.entries; refused if it is not consistent
/// (contract 3).
Result<SliceRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t place);

/// The records of the slice `index`, none if there is no such slice. O(log slices) reads, one more
/// than records where the slices of one material follow each other without a gap.
Result<std::vector<SliceRecord>> find_records(ByteSource& source, const IndexedFile& file,
                                              int index);

/// The bytes that a record locates.
struct SliceBytes {
  std::vector<std::uint8_t> node, draco, outline, segments;
};
/// Refused if their checksum is not the record's (contract 4).
Result<SliceBytes> read_slice_bytes(ByteSource& source, const IndexedFile& file,
                                    const SliceRecord& record);
/// What the header locates; refused if their checksum is not the header's.
struct DocumentTexts {
  std::vector<std::uint8_t> extras, frame;
};
Result<DocumentTexts> read_document_texts(ByteSource& source, const IndexedFile& file);

/// Writes the checksums into the slice index of a .glb, if it has one. Records that are not
/// consistent keep theirs.
void write_index_checksums(std::span<std::uint8_t> glb);

}  // namespace trocar
