// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/asset_index.h"

#include <zlib.h>

namespace trocar {
namespace {

// https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, 4. GLB File Format Specification
constexpr std::uint32_t kGlbMagic = 0x46546C67, kGlbVersion = 2;
constexpr std::uint32_t kGlbJson = 0x4E4F534A, kGlbBinary = 0x004E4942;

bool lies_within(std::uint64_t offset, std::uint64_t size, std::uint64_t whole) {
  return offset <= whole && size <= whole - offset;
}

// CRC-32, continued from `before`. Empty input is handled here because crc32_z() takes a null
// pointer for the start of a new checksum.
std::uint32_t checksum_of(std::span<const std::uint8_t> bytes, std::uint32_t before = 0) {
  if (bytes.empty()) return before;
  return static_cast<std::uint32_t>(crc32_z(before, bytes.data(), bytes.size()));
}

std::uint32_t checksum_of(EntryRecord record, const SliceBytes& bytes) {
  record.checksum = 0;
  const auto sealed = std::bit_cast<std::array<std::uint8_t, sizeof record>>(record);
  return checksum_of(bytes.draco, checksum_of(bytes.node, checksum_of(sealed)));
}

Result<std::vector<std::uint8_t>> read_bytes(ByteSource& source, std::uint64_t offset,
                                             std::uint64_t size) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  if (auto ok = source.read(offset, bytes); !ok) return ok.error();
  return bytes;
}

// Expects a consistent record: all its bytes lie in the file.
Result<SliceBytes> unchecked_bytes(ByteSource& source, const IndexedFile& file,
                                   const EntryRecord& r) {
  auto node = read_bytes(source, file.json_at + r.node_offset, r.node_bytes);
  if (!node) return node.error();
  auto draco = read_bytes(source, file.binary_at + r.draco_offset, r.draco_bytes);
  if (!draco) return draco.error();
  return SliceBytes{std::move(*node), std::move(*draco)};
}

Result<DocumentTexts> unchecked_texts(ByteSource& source, const IndexedFile& file) {
  const IndexHeader& h = file.header;
  auto extras = read_bytes(source, file.json_at + h.extras_offset, h.extras_bytes);
  if (!extras) return extras.error();
  auto frame = read_bytes(source, file.json_at + h.frame_offset, h.frame_bytes);
  if (!frame) return frame.error();
  return DocumentTexts{std::move(*extras), std::move(*frame)};
}

std::uint32_t checksum_of(const DocumentTexts& texts) {
  return checksum_of(texts.frame, checksum_of(texts.extras));
}

std::uint64_t record_at(const IndexedFile& file, std::uint32_t i) {
  return file.binary_at + sizeof file.header + i * sizeof(EntryRecord);
}

bool is_consistent(const EntryRecord& r, const IndexedFile& file) {
  return lies_within(r.node_offset, r.node_bytes, file.header.json_bytes) &&
         lies_within(r.draco_offset, r.draco_bytes, file.header.binary_bytes) &&
         (!r.is_empty() || r.draco_offset == 0);
}

}  // namespace

Result<std::uint32_t> json_bytes_of(ByteSource& source) {
  if (source.size() < kGlbHeader) return refused("not a binary glTF 2.0 file");
  const auto glb = read_as<std::array<std::uint32_t, 5>>(source, 0);
  if (!glb) return glb.error();
  const auto [magic, version, length, json_bytes, json_type] = *glb;
  if (magic != kGlbMagic || version != kGlbVersion) return refused("not a binary glTF 2.0 file");
  if (length != source.size())
    return refused("its length field says " + std::to_string(length) + " bytes, the file has " +
                   std::to_string(source.size()));
  if (json_type != kGlbJson || !lies_within(kGlbHeader, json_bytes, length))
    return refused("broken JSON chunk");
  return json_bytes;
}

Result<std::optional<IndexedFile>> find_index(ByteSource& source) {
  const auto json_bytes = json_bytes_of(source);
  if (!json_bytes) return json_bytes.error();
  IndexedFile file{{}, kGlbHeader, kGlbHeader + std::uint64_t{*json_bytes} + kGlbChunkHeader};
  if (!lies_within(file.binary_at, sizeof file.header, source.size()))
    return std::optional<IndexedFile>();
  struct Found {
    std::uint32_t binary_bytes, binary_type;
    IndexHeader header;
  };
  const auto found = read_as<Found>(source, file.binary_at - kGlbChunkHeader);
  if (!found) return found.error();
  file.header = found->header;
  const IndexHeader& h = file.header;
  const bool is_current = found->binary_type == kGlbBinary && h.magic == kIndexMagic &&
                          h.version == kIndexVersion && h.json_bytes == *json_bytes &&
                          h.binary_bytes == found->binary_bytes &&
                          file.binary_at + found->binary_bytes == source.size();
  if (!is_current) return std::optional<IndexedFile>();
  if (h.entries > kMaxSlices || !lies_within(0, file.bytes(), h.binary_bytes) ||
      !lies_within(h.extras_offset, h.extras_bytes, h.json_bytes) ||
      !lies_within(h.frame_offset, h.frame_bytes, h.json_bytes)) {
    return refused("its slice index does not fit in the file");
  }
  return std::optional(file);
}

Result<EntryRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t i) {
  auto record = read_as<EntryRecord>(source, record_at(file, i));
  if (record && !is_consistent(*record, file)) {
    return refused("slice " + std::to_string(record->index) +
                   ": the slice index points outside the file");
  }
  return record;
}

// Usually a scan has one material and no gap, so the first guess is right; otherwise bisection
// finds a record of the slice. The slice's other records are adjacent to it.
Result<std::vector<EntryRecord>> find_records(ByteSource& source, const IndexedFile& file,
                                              int index) {
  const IndexHeader& h = file.header;
  const std::int64_t end = h.entries;
  std::int64_t low = 0, high = end - 1;
  std::int64_t at = std::int64_t{index} - h.first_index;
  std::vector<EntryRecord> found;
  while (found.empty() && low <= high) {
    at = std::clamp(at, low, high);
    const auto record = read_record(source, file, static_cast<std::uint32_t>(at));
    if (!record) return record.error();
    if (record->index == index) {
      found.push_back(*record);
    } else {
      (record->index < index ? low : high) = record->index < index ? at + 1 : at - 1;
      at = low + (high - low) / 2;
    }
  }
  if (found.empty()) return found;
  std::uint64_t geometry = found[0].draco_bytes;
  for (const int step : {-1, 1}) {
    for (std::int64_t i = at + step; i >= 0 && i < end; i += step) {
      const auto record = read_record(source, file, static_cast<std::uint32_t>(i));
      if (!record) return record.error();
      if (record->index != index) break;
      // So a slice has no more records than the asset has materials.
      const std::uint32_t last = found.back().material;
      if (step < 0 ? record->material >= last : record->material <= last)
        return refused("slice " + std::to_string(index) +
                       ": the slice index has a material twice, or not in order");
      geometry += record->draco_bytes;
      if (geometry > h.binary_bytes)
        return refused("slice " + std::to_string(index) +
                       ": the slice index has entries that share their bytes");
      found.push_back(*record);
    }
    if (step < 0) std::reverse(found.begin(), found.end());
  }
  return found;
}

Result<SliceBytes> read_slice_bytes(ByteSource& source, const IndexedFile& file,
                                    const EntryRecord& record) {
  auto bytes = unchecked_bytes(source, file, record);
  if (bytes && checksum_of(record, *bytes) != record.checksum)
    return refused("its bytes are corrupted (checksum)");
  return bytes;
}

Result<DocumentTexts> read_document_texts(ByteSource& source, const IndexedFile& file) {
  auto texts = unchecked_texts(source, file);
  if (texts && checksum_of(*texts) != file.header.checksum)
    return refused("its extras are corrupted (checksum)");
  return texts;
}

void write_index_checksums(std::span<std::uint8_t> glb) {
  MemorySource source(glb);
  const auto found = find_index(source);
  if (!found || !*found) return;
  IndexedFile file = **found;
  if (const auto texts = unchecked_texts(source, file)) file.header.checksum = checksum_of(*texts);
  std::memcpy(glb.data() + file.binary_at, &file.header, sizeof file.header);
  for (std::uint32_t i = 0; i < file.header.entries; ++i) {
    auto record = read_record(source, file, i);
    if (!record) continue;
    const auto bytes = unchecked_bytes(source, file, *record);
    if (!bytes) continue;
    record->checksum = checksum_of(*record, *bytes);
    std::memcpy(glb.data() + record_at(file, i), &*record, sizeof *record);
  }
}

}  // namespace trocar
