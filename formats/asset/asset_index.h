// SPDX-License-Identifier: Apache-2.0
// The slice index of an asset locates each slice's bytes in the file, so that a reader can read the
// slices of a scene and nothing else. Internal to formats/. asset.md has the layout to the byte.
//
// The .glb of an asset consists of two chunks, the JSON chunk and the binary chunk. The index is at
// the start of the binary chunk. It consists of a header and one record of fixed size for each
// entry (one material of one slice). A reader finds any slice with a few short reads: the file's
// first 20 bytes give the start of the binary chunk, the index header gives the number of records,
// and the records are in ascending order of slices. A record has the offsets of the entry's Draco
// payload and of the text of its glTF node. The entry's plane is not in the record; plane_of()
// (payload.h) computes the plane. Other glTF readers ignore the index, because no buffer view
// covers its bytes. (The index has no chunk of its own. glTF allows a chunk after the binary chunk,
// but validators warn of such a chunk, and tools that rewrite a file drop it.)
//
// Contract:
//  1. The index counts as absent if its version is unknown, or if the chunk sizes that its header
//     states differ from the actual sizes. (Then another tool has rewritten the file.)
//  2. If there is an index, decode_asset() refuses the file unless every record, and every text to
//     which a record points, agrees with the JSON. So a reader that uses the index gets the same
//     slices as a reader that decodes the complete file.
//  3. A record with an offset or a size that points outside its chunk is refused.
//  4. A checksum (CRC-32) covers all bytes of an entry, so an entry with a changed byte is refused
//     even if it would still decode. The checksum does not cover the outlines that an asset may
//     hold as lines for viewers.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"
#include "formats/mesh/lattice.h"

namespace trocar {

/// Number of bytes of a .glb before the JSON text.
inline constexpr std::size_t kGlbHeader = 20;
/// Number of bytes of the header of each further chunk.
inline constexpr std::size_t kGlbChunkHeader = 8;
/// Returns the size of a .glb's JSON chunk. Errors: kRefused if the file is not binary glTF, or if
/// its size differs from the size in its header. Messages do not contain the file's name.
Result<std::uint32_t> json_bytes_of(ByteSource& source);

/// Reads a value that has the same bytes in memory and in the file. Errors: those of
/// ByteSource::read().
template <typename T>
Result<T> read_as(ByteSource& source, std::uint64_t offset) {
  std::array<std::uint8_t, sizeof(T)> bytes{};
  if (auto ok = source.read(offset, bytes); !ok) return ok.error();
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

inline constexpr std::array<char, 8> kIndexMagic{'T', 'R', 'O', 'C', 'A', 'R', 'I', 'X'};
inline constexpr std::uint32_t kIndexVersion = 3;
/// Largest number of slices, and of entries, in an asset.
inline constexpr std::size_t kMaxSlices = 100'000;

// The next two structures have the same bytes in memory and in the file (little-endian).

struct IndexHeader {
  std::array<char, 8> magic = kIndexMagic;
  std::uint32_t version = kIndexVersion;
  std::uint32_t entries = 0;                       ///< number of records
  std::uint32_t json_bytes = 0, binary_bytes = 0;  ///< the chunks' sizes
  std::uint32_t extras_offset = 0,
                extras_bytes = 0;  ///< location of the asset's data (extras) in the JSON text
  std::uint32_t checksum = 0;      ///< CRC-32 of the extras and the frame
  /// AssetSlice::index in the first and in the last record; 0 if there are no records.
  std::int32_t first_index = 0, last_index = 0;
  /// Location of the frame's text in the JSON text. The frame is the node whose transform all
  /// slices share.
  std::uint32_t frame_offset = 0, frame_bytes = 0;
};

/// Locates an entry's bytes: the text of its node, and its Draco payload, which holds the
/// triangles. If the slice is empty, draco_offset and draco_bytes are 0.
struct EntryRecord {
  std::int32_t index = 0;         ///< AssetSlice::index
  std::uint32_t node_offset = 0;  ///< counted from the start of the JSON text
  std::uint16_t node_bytes = 0, material = 0;
  /// `draco_offset` is counted from the start of the binary chunk's data.
  std::uint32_t draco_offset = 0, draco_bytes = 0;
  /// CRC-32 of this record (with checksum 0) followed by the node's text and the payload.
  std::uint32_t checksum = 0;

  bool is_empty() const { return draco_bytes == 0; }
};

static_assert(sizeof(IndexHeader) == 52 && std::is_trivially_copyable_v<IndexHeader>);
static_assert(sizeof(EntryRecord) == 24 && std::is_trivially_copyable_v<EntryRecord>);

/// The index header of a file, and the positions of the file's chunks.
struct IndexedFile {
  IndexHeader header;
  std::uint64_t json_at = 0, binary_at = 0;  ///< offsets of the chunks' data in the file

  std::uint64_t bytes() const { return sizeof header + header.entries * sizeof(EntryRecord); }
};
/// Reads the index header. Returns std::nullopt if the file has no index (contract 1). Errors:
/// those of json_bytes_of(); kRefused if the index does not fit in the file.
Result<std::optional<IndexedFile>> find_index(ByteSource& source);

/// Reads record number i, 0 <= i < header.entries. Errors: kRefused if an offset or a size points
/// outside the file (contract 3).
Result<EntryRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t i);

/// Finds the records of the slice `index`, in order of their materials; none if there is no such
/// slice. Errors: those of read_record(); also kRefused if a material occurs twice or not in order,
/// or if the payloads of the slice would be longer than the file's binary data. Takes
/// O(log entries) reads, plus one for each material of the slice. If the scan has one material and
/// no slice is missing, at most three reads are needed.
Result<std::vector<EntryRecord>> find_records(ByteSource& source, const IndexedFile& file,
                                              int index);

/// The bytes to which a record points.
struct SliceBytes {
  std::vector<std::uint8_t> node, draco;
};
/// Reads the bytes to which a record points. Errors: kRefused if the checksum of record and bytes
/// differs from the checksum in the record (contract 4).
Result<SliceBytes> read_slice_bytes(ByteSource& source, const IndexedFile& file,
                                    const EntryRecord& record);
/// The texts to which the header points.
struct DocumentTexts {
  std::vector<std::uint8_t> extras, frame;
};
/// Reads the texts to which the header points. Errors: kRefused if their checksum differs from the
/// checksum in the header.
Result<DocumentTexts> read_document_texts(ByteSource& source, const IndexedFile& file);

/// Computes the checksums of a .glb's slice index and writes them into the index. Does nothing if
/// there is no index. Records that point outside the file are not changed.
void write_index_checksums(std::span<std::uint8_t> glb);

}  // namespace trocar
