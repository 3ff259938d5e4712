// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/hu_section.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "formats/asset/asset_index.h"
#include "formats/asset/hu_codec.h"

namespace trocar {
namespace {

using nlohmann::json;

constexpr int kHuVersion = 1;

// A record of the directory, little-endian as in the file. A plane's bytes begin where those of the
// plane before it end.
struct PlaneRecord {
  std::int32_t index = 0;  // AssetSlice::index
  std::uint32_t end = 0;   // offset in the view
};
static_assert(sizeof(PlaneRecord) == 8 && std::is_trivially_copyable_v<PlaneRecord>);

std::uint64_t directory_bytes(const HuSection& section) {
  return section.planes * sizeof(PlaneRecord);
}

Result<PlaneRecord> read_record(ByteSource& source, std::uint64_t binary_at,
                                const HuSection& section, std::uint64_t i) {
  return read_as<PlaneRecord>(source, binary_at + section.offset + i * sizeof(PlaneRecord));
}

struct PlaneBytes {
  std::uint64_t offset = 0, size = 0;  // in the view
};
Result<PlaneBytes> plane_bytes(ByteSource& source, std::uint64_t binary_at,
                               const HuSection& section, std::uint64_t i) {
  std::uint64_t start = directory_bytes(section);
  if (i > 0) {
    const auto before = read_record(source, binary_at, section, i - 1);
    if (!before) return before.error();
    start = before->end;
  }
  const auto record = read_record(source, binary_at, section, i);
  if (!record) return record.error();
  if (start < directory_bytes(section) || record->end < start || record->end > section.bytes)
    return refused("the directory of its HU is damaged");
  return PlaneBytes{start, record->end - start};
}

// The number of a slice's record; none if it has no plane.
Result<std::optional<std::uint64_t>> find_plane(ByteSource& source, std::uint64_t binary_at,
                                                const HuSection& section, int index) {
  std::uint64_t low = 0, high = section.planes;
  while (low < high) {
    const std::uint64_t middle = low + (high - low) / 2;
    const auto record = read_record(source, binary_at, section, middle);
    if (!record) return record.error();
    if (record->index == index) return std::optional(middle);
    (record->index < index ? low : high) = record->index < index ? middle + 1 : middle;
  }
  return std::optional<std::uint64_t>();
}

// A list of two finite numbers.
std::optional<Eigen::Vector2d> pair_of(const json& list) {
  if (!list.is_array() || list.size() != 2 || !list[0].is_number() || !list[1].is_number())
    return std::nullopt;
  const Eigen::Vector2d out(list[0].get<double>(), list[1].get<double>());
  return out.allFinite() ? std::optional(out) : std::nullopt;
}

// A whole number from 0 to `most`.
std::optional<std::uint32_t> whole_number(const json& ours, const char* key, std::uint32_t most) {
  const auto found = ours.find(key);
  if (found == ours.end() || !found->is_number_unsigned() || *found > most) return std::nullopt;
  return found->get<std::uint32_t>();
}

std::optional<HuSection> section_of(const json& ours) {
  constexpr std::uint32_t kAny = std::numeric_limits<std::uint32_t>::max();
  HuSection out;
  const auto origin = pair_of(ours.value("origin_mm", json())),
             pitch = pair_of(ours.value("pitch_mm", json())),
             size = pair_of(ours.value("size", json()));
  const auto view = whole_number(ours, "bufferView", kAny),
             offset = whole_number(ours, "byteOffset", kAny),
             bytes = whole_number(ours, "byteLength", kAny),
             planes = whole_number(ours, "planes", kMaxSlices),
             step = whole_number(ours, "step_hu", 1 << 16);
  if (!origin || !pitch || !size || !view || !offset || !bytes || !planes || !step ||
      *size != size->array().rint().matrix() || size->minCoeff() < 1 ||
      size->maxCoeff() > kMaxHuSide)
    return std::nullopt;
  if (ours.contains("margin_steps")) {
    const auto margin = whole_number(ours, "margin_steps", kMaxHuMargin);
    if (!margin) return std::nullopt;
    out.grid.margin_steps = static_cast<std::int32_t>(*margin);
  }
  out.grid.origin_mm = *origin;
  out.grid.pitch_mm = *pitch;
  out.grid.columns = static_cast<int>(size->x());
  out.grid.rows = static_cast<int>(size->y());
  out.grid.step_hu = static_cast<int>(*step);
  out.view = *view;
  out.offset = *offset;
  out.bytes = *bytes;
  out.planes = *planes;
  return out.bytes >= directory_bytes(out) ? std::optional(out) : std::nullopt;
}

// The plane of a slice, if it has one. `entries` are the slice's.
Result<std::optional<HuPlane>> read_plane(ByteSource& source, std::uint64_t binary_at,
                                          const HuSection& section, const Lattice& lattice,
                                          std::span<const AssetSlice> entries) {
  std::vector<const Pslg*> outlines;
  for (const AssetSlice& entry : entries) {
    if (!entry.pslg.rings.empty()) outlines.push_back(&entry.pslg);
  }
  if (outlines.empty() && !section.grid.covers_everything()) return std::optional<HuPlane>();
  const auto number = find_plane(source, binary_at, section, entries[0].index);
  if (!number) return number.error();
  if (!*number) return std::optional<HuPlane>();
  const auto place = plane_bytes(source, binary_at, section, **number);
  if (!place) return place.error();
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(place->size));
  if (auto ok = source.read(binary_at + section.offset + place->offset, bytes); !ok)
    return ok.error();
  auto plane = decode_hu_plane(bytes, section.grid, lattice, outlines);
  if (!plane) return plane.error();
  plane->index = entries[0].index;
  plane->T_lps_plane = entries[0].T_lps_plane;
  return std::optional(std::move(*plane));
}

}  // namespace

json add_hu_volume(GltfWriter& gltf, const EncodedHuVolume& volume) {
  std::vector<std::uint8_t> bytes(volume.planes.size() * sizeof(PlaneRecord));
  for (std::size_t i = 0; i < volume.planes.size(); ++i) {
    const EncodedHuPlane& plane = volume.planes[i];
    bytes.insert(bytes.end(), plane.bytes.begin(), plane.bytes.end());
    const PlaneRecord record{plane.index, static_cast<std::uint32_t>(bytes.size())};
    std::memcpy(bytes.data() + i * sizeof record, &record, sizeof record);
  }
  const auto [view, range] = gltf.add_view(bytes.data(), bytes.size(), GltfWriter::kNoTarget);
  const HuGrid& grid = volume.grid;
  json out = {{"version", kHuVersion},
              {"bufferView", view},
              {"byteOffset", range.offset},
              {"byteLength", range.size},
              {"planes", volume.planes.size()},
              {"origin_mm", {grid.origin_mm.x(), grid.origin_mm.y()}},
              {"pitch_mm", {grid.pitch_mm.x(), grid.pitch_mm.y()}},
              {"size", {grid.columns, grid.rows}},
              {"step_hu", grid.step_hu}};
  if (!grid.covers_everything()) out["margin_steps"] = grid.margin_steps;
  return out;
}

Result<std::vector<HuSection>> hu_sections(const json& ours, const Lattice& lattice) {
  std::vector<HuSection> out;
  if (!ours.is_object() || !ours.contains("hu_volumes")) return out;
  const json& list = ours["hu_volumes"];
  if (!list.is_array() || list.size() > 2) return refused("hu_volumes is not a list of one or two");
  for (const json& one : list) {
    if (!one.is_object() || one.value("version", json()) != kHuVersion)
      return refused("its HU are of a version that this program does not know");
    const auto section = section_of(one);
    if (!section) return refused("hu_volumes: a number that is missing or out of range");
    if (auto ok = check_hu_grid(section->grid, lattice); !ok) return ok.error();
    out.push_back(*section);
  }
  if (out.size() == 2 && out[0].grid.covers_everything() == out[1].grid.covers_everything())
    return refused("hu_volumes has two volumes of the same kind");
  return out;
}

Result<void> read_hu_volumes(ByteSource& source, std::uint64_t binary_at,
                             std::uint64_t binary_bytes, const std::vector<HuSection>& sections,
                             bool with_context, Asset& asset) {
  std::uint64_t left = max_hu_samples(source.size());  // that all volumes together may still have
  for (const HuSection& section : sections) {
    if (section.offset > binary_bytes || section.bytes > binary_bytes - section.offset)
      return refused("its HU lie outside the file");
    const bool is_context = section.grid.covers_everything();
    HuVolume& volume = is_context ? asset.context : asset.hu;
    volume.grid = section.grid;
    if (is_context && !with_context) continue;
    for (std::size_t i = 0; i < asset.slices.size();) {
      const std::span<const AssetSlice> entries = materials_of_slice(asset, i);
      i += entries.size();
      const std::string where = "slice " + std::to_string(entries[0].index) + ": ";
      auto plane = read_plane(source, binary_at, section, asset.lattice, entries);
      if (!plane) return refused(where + plane.error().message);
      if (!*plane) continue;
      if ((*plane)->hu.size() > left)
        return refused(where + "more HU than a file of its size may have");
      left -= (*plane)->hu.size();
      volume.planes.push_back(std::move(**plane));
    }
  }
  return {};
}

Result<void> check_hu_directory(ByteSource& source, std::uint64_t binary_at,
                                const HuSection& section, bool is_whole, const Asset& asset) {
  const Error damaged = refused("the directory of its HU is damaged");
  std::uint64_t end = directory_bytes(section);
  auto slice = asset.slices.begin();
  for (std::uint32_t i = 0; i < section.planes; ++i) {
    const auto record = read_record(source, binary_at, section, i);
    if (!record) return record.error();
    slice = std::find_if(slice, asset.slices.end(),
                         [&](const AssetSlice& one) { return one.index >= record->index; });
    if (slice == asset.slices.end() || slice->index != record->index || record->end < end)
      return damaged;
    bool has_samples = section.grid.covers_everything() || !is_whole;
    for (; slice != asset.slices.end() && slice->index == record->index; ++slice)
      has_samples |= !slice->pslg.rings.empty();
    if (!has_samples && record->end != end)
      return refused("a plane of HU without stored samples has bytes");
    end = record->end;
  }
  return end == section.bytes ? Result<void>() : damaged;
}

}  // namespace trocar
