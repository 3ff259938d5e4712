// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/asset_index.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <utility>

namespace trocar {
namespace {

// https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, 4. GLB File Format Specification
constexpr std::uint32_t kGlbMagic = 0x46546C67, kGlbVersion = 2;
constexpr std::uint32_t kGlbJson = 0x4E4F534A, kGlbBinary = 0x004E4942;

template <typename T>
Result<T> read_as(ByteSource& source, std::uint64_t offset) {
  std::array<std::uint8_t, sizeof(T)> bytes{};
  if (auto ok = source.read(offset, bytes); !ok) return ok.error();
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

bool lies_within(std::uint64_t offset, std::uint64_t size, std::uint64_t whole) {
  return offset <= whole && size <= whole - offset;
}

// CRC-32, continued from `before`. No bytes leave it unchanged: crc32_z() would take a null pointer
// for the start of a new checksum.
std::uint32_t checksum_of(std::span<const std::uint8_t> bytes, std::uint32_t before = 0) {
  if (bytes.empty()) return before;
  return static_cast<std::uint32_t>(crc32_z(before, bytes.data(), bytes.size()));
}

std::uint32_t checksum_of(SliceRecord record, const SliceBytes& bytes) {
  record.checksum = 0;
  std::array<std::uint8_t, sizeof record> own{};
  std::memcpy(own.data(), &record, sizeof record);
  std::uint32_t sum = checksum_of(own);
  for (const auto* part : {&bytes.node, &bytes.draco, &bytes.outline, &bytes.segments})
    sum = checksum_of(*part, sum);
  return sum;
}

Result<std::vector<std::uint8_t>> read_bytes(ByteSource& source, std::uint64_t offset,
                                             std::uint64_t size) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  if (auto ok = source.read(offset, bytes); !ok) return ok.error();
  return bytes;
}

// `r` is consistent: all its bytes lie in the file.
Result<SliceBytes> unchecked_bytes(ByteSource& source, const IndexedFile& file,
                                   const SliceRecord& r) {
  SliceBytes out;
  const auto take = [&](std::vector<std::uint8_t>& into, std::uint64_t offset,
                        std::uint64_t size) -> Result<void> {
    auto bytes = read_bytes(source, offset, size);
    if (!bytes) return bytes.error();
    into = std::move(*bytes);
    return {};
  };
  if (auto ok = take(out.node, file.json_at + r.node_offset, r.node_bytes); !ok) return ok.error();
  if (r.triangles == 0) return out;
  if (auto ok = take(out.draco, file.binary_at + r.draco_offset, r.draco_bytes); !ok)
    return ok.error();
  if (auto ok = take(out.outline, file.binary_at + r.outline_offset, r.outline_bytes()); !ok)
    return ok.error();
  if (auto ok = take(out.segments, file.binary_at + r.segments_offset, r.segments_bytes()); !ok)
    return ok.error();
  return out;
}

std::uint64_t record_at(const IndexedFile& file, std::uint32_t place) {
  return file.binary_at + sizeof(IndexHeader) + std::uint64_t{place} * sizeof(SliceRecord);
}

bool is_consistent(const SliceRecord& r, const IndexHeader& header) {
  const std::uint64_t binary = header.binary_bytes;
  if (!lies_within(r.node_offset, r.node_bytes, header.json_bytes)) return false;
  if (r.triangles == 0) {
    SliceRecord empty;
    empty.index = r.index;
    empty.node_offset = r.node_offset;
    empty.node_bytes = r.node_bytes;
    empty.checksum = r.checksum;
    return r == empty;
  }
  return (r.segment_index_bytes == 2 || r.segment_index_bytes == 4) &&
         lies_within(r.draco_offset, r.draco_bytes, binary) &&
         lies_within(r.outline_offset, r.outline_bytes(), binary) &&
         lies_within(r.segments_offset, r.segments_bytes(), binary);
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
  if (!lies_within(file.binary_at, sizeof(IndexHeader), source.size()))
    return std::optional<IndexedFile>();
  struct Found {
    std::uint32_t binary_bytes, binary_type;
    IndexHeader header;
  };
  const auto found = read_as<Found>(source, file.binary_at - kGlbChunkHeader);
  if (!found) return found.error();
  file.header = found->header;
  const IndexHeader& h = file.header;
  const bool ours = found->binary_type == kGlbBinary && h.magic == kIndexMagic &&
                    h.version == kIndexVersion && h.json_bytes == *json_bytes &&
                    h.binary_bytes == found->binary_bytes &&
                    file.binary_at + found->binary_bytes == source.size();
  if (!ours) return std::optional<IndexedFile>();
  if (h.slices > kMaxSlices ||
      !lies_within(sizeof h, std::uint64_t{h.slices} * sizeof(SliceRecord), h.binary_bytes) ||
      !lies_within(h.extras_offset, h.extras_bytes, h.json_bytes)) {
    return refused("its slice index does not fit in the file");
  }
  return std::optional(file);
}

Result<SliceRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t place) {
  auto record = read_as<SliceRecord>(source, record_at(file, place));
  if (record && !is_consistent(*record, file.header)) {
    return refused("slice " + std::to_string(record->index) +
                   ": the slice index points outside the file");
  }
  return record;
}

// Slices mostly follow each other without a gap, so that the first place tried is the right one.
// After that: bisection.
Result<std::optional<SliceRecord>> find_record(ByteSource& source, const IndexedFile& file,
                                               int index) {
  const IndexHeader& h = file.header;
  std::int64_t low = 0, high = std::int64_t{h.slices} - 1;
  std::int64_t place = std::int64_t{index} - h.first_index;
  while (low <= high) {
    place = std::clamp(place, low, high);
    const auto record = read_record(source, file, static_cast<std::uint32_t>(place));
    if (!record) return record.error();
    if (record->index == index) return std::optional(*record);
    (record->index < index ? low : high) = record->index < index ? place + 1 : place - 1;
    place = low + (high - low) / 2;
  }
  return std::optional<SliceRecord>();
}

Result<SliceBytes> read_slice_bytes(ByteSource& source, const IndexedFile& file,
                                    const SliceRecord& record) {
  auto bytes = unchecked_bytes(source, file, record);
  if (bytes && checksum_of(record, *bytes) != record.checksum)
    return refused("its bytes are corrupted (checksum)");
  return bytes;
}

Result<std::vector<std::uint8_t>> read_extras(ByteSource& source, const IndexedFile& file) {
  const IndexHeader& h = file.header;
  auto text = read_bytes(source, file.json_at + h.extras_offset, h.extras_bytes);
  if (text && checksum_of(*text) != h.extras_checksum)
    return refused("its extras are corrupted (checksum)");
  return text;
}

void write_index_checksums(std::span<std::uint8_t> glb) {
  MemorySource source(glb);
  const auto found = find_index(source);
  if (!found || !*found) return;
  IndexedFile file = **found;
  const auto text =
      read_bytes(source, file.json_at + file.header.extras_offset, file.header.extras_bytes);
  if (text) file.header.extras_checksum = checksum_of(*text);
  std::memcpy(glb.data() + file.binary_at, &file.header, sizeof file.header);
  for (std::uint32_t place = 0; place < file.header.slices; ++place) {
    auto record = read_record(source, file, place);
    if (!record) continue;
    const auto bytes = unchecked_bytes(source, file, *record);
    if (bytes) record->checksum = checksum_of(*record, *bytes);
    std::memcpy(glb.data() + record_at(file, place), &*record, sizeof(SliceRecord));
  }
}

}  // namespace trocar
