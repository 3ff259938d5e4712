// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/slice_payload.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "formats/asset/draco_mesh.h"
#include "formats/base/json_text.h"

namespace trocar {
namespace {

constexpr int kMaxJsonDepth = 64;

template <typename T>
std::vector<T> elements(std::span<const std::uint8_t> bytes) {
  std::vector<T> out(bytes.size() / sizeof(T));
  if (!out.empty()) std::memcpy(out.data(), bytes.data(), out.size() * sizeof(T));
  return out;
}

Result<SliceMesh> decode_triangles(const SliceRecord& record, std::span<const std::uint8_t> draco,
                                   const Lattice& lattice) {
  auto mesh = decode_draco(draco, lattice, record.vertices, record.triangles);
  if (!mesh) return mesh;
  if (mesh->vertices.size() != record.vertices || mesh->triangles.size() != record.triangles)
    return refused("Draco payload and accessor counts differ");
  LatticePoint low = mesh->vertices.empty() ? LatticePoint{} : mesh->vertices.front(), high = low;
  for (const LatticePoint p : mesh->vertices) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  if (record.low != low || record.high != high)
    return refused("accessor bounds differ from the vertices");
  return mesh;
}

Result<Pslg> decode_lines(const SliceRecord& record, const GeometryBytes& bytes,
                          const Lattice& lattice) {
  const std::size_t count = record.outline_vertices;
  const auto xyz = elements<float>(bytes.outline);
  std::vector<std::uint32_t> indices;
  if (record.segment_index_bytes == 2) {
    const auto narrow = elements<std::uint16_t>(bytes.segments);
    indices.assign(narrow.begin(), narrow.end());
  } else {
    indices = elements<std::uint32_t>(bytes.segments);
  }
  if (xyz.size() != 3 * count || indices.size() != 2 * count)
    return refused("outline data outside the buffer or of the wrong size");
  // The segments of a ring: (f, f+1) (f+1, f+2) ... (l, f).
  Pslg pslg;
  Ring ring;
  std::size_t first = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = std::ldexp(static_cast<double>(xyz[3 * i]), lattice.bits);
    const double y = std::ldexp(static_cast<double>(xyz[3 * i + 1]), lattice.bits);
    if (!(std::abs(x) <= kMaxCoordinate && std::abs(y) <= kMaxCoordinate) || x != std::rint(x) ||
        y != std::rint(y) || xyz[3 * i + 2] != 0.0F) {
      return refused("outline vertex " + std::to_string(i) + " is off the lattice");
    }
    ring.push_back({static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)});
    const std::uint32_t to = indices[2 * i + 1];
    if (indices[2 * i] != i || (to != i + 1 && to != first) || (to == first && ring.size() < 3)) {
      return refused("outline segment " + std::to_string(i) + " does not continue its ring");
    }
    if (to == first) {
      pslg.rings.push_back(std::exchange(ring, {}));
      first = i + 1;
    }
  }
  if (!ring.empty()) return refused("outline ring not closed");
  return pslg;
}

// The value under `key` of a JSON object given as text; null if there is none.
nlohmann::json value_of(const std::string& object, const char* key) {
  const nlohmann::json parsed = nlohmann::json::parse(object, nullptr, false);
  return parsed.is_object() ? parsed.value(key, nlohmann::json()) : nlohmann::json();
}

}  // namespace

std::vector<int> labels_of(const Asset& asset) {
  std::vector<int> out;
  const nlohmann::json labels = value_of(asset.parameters_json, "labels");
  if (!labels.is_array()) return out;
  for (const nlohmann::json& label : labels) {
    if (!label.is_number()) continue;
    const double number = label.get<double>();
    if (number == std::rint(number) && number >= std::numeric_limits<int>::min() &&
        number <= std::numeric_limits<int>::max()) {
      out.push_back(static_cast<int>(number));
    }
  }
  return out;
}

std::optional<double> mean_hu_of(const AssetSlice& slice) {
  const nlohmann::json mean_hu = value_of(slice.measures_json, "mean_hu");
  return mean_hu.is_number() ? std::optional(mean_hu.get<double>()) : std::nullopt;
}

Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const std::uint8_t c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      in_string = c != '"';
    } else if (c == '"') {
      in_string = true;
    } else if (c == '{' || c == '[') {
      if (++depth > kMaxJsonDepth) return refused("JSON nested too deeply");
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  nlohmann::json parsed = nlohmann::json::parse(text.begin(), text.end(), nullptr, false);
  if (parsed.is_discarded()) return refused("its JSON does not parse");
  return parsed;
}

nlohmann::json trocar_extras(const nlohmann::json& extras) {
  return extras.is_object() && extras.contains("trocar") ? extras["trocar"] : nullptr;
}

Result<void> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                  const std::string& name) {
  const nlohmann::json ours = trocar_extras(extras);
  if (!ours.is_object() || ours.value("schema", nlohmann::json()) != kAssetSchema) {
    return refused(name + ": not a Trocar asset of schema " + std::to_string(kAssetSchema));
  }
  const nlohmann::json bits = ours.value("lattice_bits", nlohmann::json());
  if (!bits.is_number_integer() || bits < kMinLatticeBits || bits > kMaxLatticeBits) {
    return refused(name + ": lattice_bits missing or out of range");
  }
  asset.lattice.bits = bits.get<int>();
  asset.parameters_json = json_text(ours.value("parameters", nlohmann::json::object()));
  const nlohmann::json digest = ours.value("input_digest", nlohmann::json());
  if (digest.is_string()) asset.input_digest = digest.get<std::string>();
  return {};
}

Result<AssetSlice> slice_of_node(const nlohmann::json& node) {
  const nlohmann::json ours =
      node.is_object() && node.contains("extras") ? trocar_extras(node["extras"]) : nullptr;
  if (!ours.is_object() || !ours.contains("index") || !ours["index"].is_number_integer() ||
      !ours.contains("z_mm") || !ours["z_mm"].is_number()) {
    return refused("a slice node without index and z_mm");
  }
  AssetSlice slice;
  if (std::abs(ours["index"].get<double>()) > std::numeric_limits<int>::max())
    return refused("a slice index out of range");
  slice.index = ours["index"].get<int>();
  slice.z_mm = ours["z_mm"].get<double>();
  slice.measures_json = json_text(ours.value("measures", nlohmann::json::object()));
  const nlohmann::json matrix = node.value("matrix", nlohmann::json());
  if (!matrix.is_array() || matrix.size() != 16 ||
      !std::all_of(matrix.begin(), matrix.end(), [](const nlohmann::json& number) {
        return number.is_number() && std::isfinite(number.get<double>());
      })) {
    return refused("slice " + std::to_string(slice.index) + ": node without a finite matrix");
  }
  std::array<double, 16> column_major{};
  std::transform(matrix.begin(), matrix.end(), column_major.begin(),
                 [](const nlohmann::json& number) { return number.get<double>(); });
  slice.T_lps_plane.matrix() = Eigen::Map<const Eigen::Matrix4d>(column_major.data());
  return slice;
}

Result<void> decode_slice_geometry(const SliceRecord& record, const GeometryBytes& bytes,
                                   const Lattice& lattice, AssetSlice& slice) {
  auto mesh = decode_triangles(record, bytes.draco, lattice);
  if (!mesh) return mesh.error();
  auto pslg = decode_lines(record, bytes, lattice);
  if (!pslg) return pslg.error();
  slice.mesh = std::move(*mesh);
  slice.pslg = std::move(*pslg);
  return {};
}

}  // namespace trocar
