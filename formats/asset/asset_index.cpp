// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/asset_index.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <tuple>
#include <utility>

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

// The record's bytes in the file, with this checksum.
std::vector<std::uint8_t> record_bytes(const IndexedFile& file, const SliceRecord& r,
                                       std::uint32_t checksum) {
  std::vector<std::uint8_t> out(file.record_bytes());
  if (file.is_schema_1()) {
    SliceRecord1 record = r;
    record.checksum = checksum;
    std::memcpy(out.data(), &record, sizeof record);
  } else {
    const EntryRecord record{r.index,    r.node_offset,  static_cast<std::uint16_t>(r.node_bytes),
                             r.material, r.draco_offset, r.draco_bytes,
                             checksum};
    std::memcpy(out.data(), &record, sizeof record);
  }
  return out;
}

std::uint32_t checksum_of(const IndexedFile& file, const SliceRecord& record,
                          const SliceBytes& bytes) {
  std::uint32_t sum = checksum_of(record_bytes(file, record, 0));
  for (const auto* section : {&bytes.node, &bytes.draco, &bytes.outline, &bytes.segments})
    sum = checksum_of(*section, sum);
  return sum;
}

Result<std::vector<std::uint8_t>> read_bytes(ByteSource& source, std::uint64_t offset,
                                             std::uint64_t size) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  if (auto ok = source.read(offset, bytes); !ok) return ok.error();
  return bytes;
}

// Expects a consistent record: all its bytes lie in the file.
Result<SliceBytes> unchecked_bytes(ByteSource& source, const IndexedFile& file,
                                   const SliceRecord& r) {
  SliceBytes out;
  const std::tuple<std::vector<std::uint8_t>&, std::uint64_t, std::uint64_t> sections[] = {
      {out.node, file.json_at + r.node_offset, r.node_bytes},
      {out.draco, file.binary_at + r.draco_offset, r.draco_bytes},
      {out.outline, file.binary_at + r.outline_offset, r.outline_bytes()},
      {out.segments, file.binary_at + r.segments_offset, r.segments_bytes()}};
  for (const auto& [into, offset, size] : sections) {
    auto bytes = read_bytes(source, offset, size);
    if (!bytes) return bytes.error();
    into = std::move(*bytes);
  }
  return out;
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
  return file.binary_at + file.header_bytes() + i * file.record_bytes();
}

bool is_consistent(const SliceRecord& r, const IndexedFile& file) {
  const std::uint64_t binary = file.header.binary_bytes;
  if (!lies_within(r.node_offset, r.node_bytes, file.header.json_bytes)) return false;
  if (r.is_empty()) {
    return r.draco_offset == 0 && r.vertices == 0 && r.triangles == 0 && r.low == LatticePoint{} &&
           r.high == LatticePoint{} && r.outline_offset == 0 && r.outline_vertices == 0 &&
           r.segments_offset == 0 && r.segment_index_bytes == 0;
  }
  if (!lies_within(r.draco_offset, r.draco_bytes, binary)) return false;
  return !file.is_schema_1() ||
         (r.triangles > 0 && (r.segment_index_bytes == 2 || r.segment_index_bytes == 4) &&
          lies_within(r.outline_offset, r.outline_bytes(), binary) &&
          lies_within(r.segments_offset, r.segments_bytes(), binary));
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
  if (!lies_within(file.binary_at, kIndexHeader1Bytes, source.size()))
    return std::optional<IndexedFile>();
  struct Found {
    std::uint32_t binary_bytes, binary_type;
    std::array<std::uint8_t, kIndexHeader1Bytes> header;
  };
  const auto found = read_as<Found>(source, file.binary_at - kGlbChunkHeader);
  if (!found) return found.error();
  IndexHeader& h = file.header;
  std::memcpy(&h, found->header.data(), found->header.size());
  const bool is_current = found->binary_type == kGlbBinary && h.magic == kIndexMagic &&
                          (h.version == kIndexVersion || h.version == kIndexVersion1) &&
                          h.json_bytes == *json_bytes && h.binary_bytes == found->binary_bytes &&
                          file.binary_at + found->binary_bytes == source.size();
  if (!is_current) return std::optional<IndexedFile>();
  const Error misfit = refused("its slice index does not fit in the file");
  if (!file.is_schema_1()) {
    if (!lies_within(0, sizeof h, h.binary_bytes)) return misfit;
    const auto whole = read_as<IndexHeader>(source, file.binary_at);
    if (!whole) return whole.error();
    h = *whole;
  }
  if (h.entries > kMaxSlices || !lies_within(0, file.bytes(), h.binary_bytes) ||
      !lies_within(h.extras_offset, h.extras_bytes, h.json_bytes) ||
      !lies_within(h.frame_offset, h.frame_bytes, h.json_bytes)) {
    return misfit;
  }
  return std::optional(file);
}

Result<SliceRecord> read_record(ByteSource& source, const IndexedFile& file, std::uint32_t i) {
  SliceRecord out;
  if (file.is_schema_1()) {
    const auto record = read_as<SliceRecord1>(source, record_at(file, i));
    if (!record) return record.error();
    static_cast<SliceRecord1&>(out) = *record;
  } else {
    const auto record = read_as<EntryRecord>(source, record_at(file, i));
    if (!record) return record.error();
    out.index = record->index;
    out.node_offset = record->node_offset;
    out.node_bytes = record->node_bytes;
    out.draco_offset = record->draco_offset;
    out.draco_bytes = record->draco_bytes;
    out.checksum = record->checksum;
    out.material = record->material;
  }
  if (!is_consistent(out, file)) {
    return refused("slice " + std::to_string(out.index) +
                   ": the slice index points outside the file");
  }
  return out;
}

// Usually a scan has one material and no gap, so the first guess is right; otherwise bisection
// finds a record of the slice. The slice's other records are adjacent to it.
Result<std::vector<SliceRecord>> find_records(ByteSource& source, const IndexedFile& file,
                                              int index) {
  const IndexHeader& h = file.header;
  const std::int64_t end = h.entries;
  std::int64_t low = 0, high = end - 1;
  std::int64_t at = std::int64_t{index} - h.first_index;
  std::vector<SliceRecord> found;
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
  if (found.empty() || file.is_schema_1()) return found;
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
                                    const SliceRecord& record) {
  auto bytes = unchecked_bytes(source, file, record);
  if (bytes && checksum_of(file, record, *bytes) != record.checksum)
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
  std::memcpy(glb.data() + file.binary_at, &file.header, file.header_bytes());
  for (std::uint32_t i = 0; i < file.header.entries; ++i) {
    const auto record = read_record(source, file, i);
    if (!record) continue;
    const auto bytes = unchecked_bytes(source, file, *record);
    if (!bytes) continue;
    const auto sealed = record_bytes(file, *record, checksum_of(file, *record, *bytes));
    std::memcpy(glb.data() + record_at(file, i), sealed.data(), sealed.size());
  }
}

}  // namespace trocar
