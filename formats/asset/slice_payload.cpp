// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/slice_payload.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/asset/draco_mesh.h"
#include "formats/asset/stated_entries.h"
#include "formats/base/json_text.h"
#include "formats/geometry/mesh_validity.h"

namespace trocar {
namespace {

constexpr std::size_t kMaxMaterials = 65'535;

template <typename T>
std::vector<T> elements(std::span<const std::uint8_t> bytes) {
  std::vector<T> out(bytes.size() / sizeof(T));
  if (!out.empty()) std::memcpy(out.data(), bytes.data(), out.size() * sizeof(T));
  return out;
}

Result<Pslg> decode_lines(const StatedEntry& stated, std::span<const std::uint8_t> binary) {
  const std::size_t count = stated.outline_vertices;
  const auto xyz = elements<float>(binary.subspan(stated.outline_offset, stated.outline_bytes()));
  const auto segments = binary.subspan(stated.segments_offset, stated.segments_bytes());
  std::vector<std::uint32_t> indices;
  if (stated.segment_index_bytes == 2) {
    const auto narrow = elements<std::uint16_t>(segments);
    indices.assign(narrow.begin(), narrow.end());
  } else {
    indices = elements<std::uint32_t>(segments);
  }
  if (xyz.size() != 3 * count || indices.size() != 2 * count)
    return refused("outline data outside the buffer or of the wrong size");
  // The segments of a ring are (f, f+1) (f+1, f+2) ... (l, f).
  Pslg pslg;
  Ring ring;
  std::size_t first = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = xyz[3 * i], y = xyz[3 * i + 1];
    if (!(std::abs(x) <= kMaxCoordinate && std::abs(y) <= kMaxCoordinate) || x != std::rint(x) ||
        y != std::rint(y) || xyz[3 * i + 2] != static_cast<float>(stated.z)) {
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
  const nlohmann::json parsed = parse_json(object);
  return parsed.is_object() ? parsed.value(key, nlohmann::json()) : nlohmann::json();
}

bool are_finite_numbers(const nlohmann::json& list, std::size_t count) {
  return list.is_array() && list.size() == count &&
         std::all_of(list.begin(), list.end(), [](const nlohmann::json& number) {
           return number.is_number() && std::isfinite(number.get<double>());
         });
}

// The matrix whose 16 numbers stand in the list column by column.
Eigen::Matrix4d matrix_of(const nlohmann::json& list) {
  const auto column_major = list.get<std::array<double, 16>>();
  return Eigen::Map<const Eigen::Matrix4d>(column_major.data());
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
  if (mean_hu.is_number()) return mean_hu.get<double>();
  if (slice.hu.empty()) return std::nullopt;
  // The mean of a linear function over a triangle is the mean of its corners. The sums are sums of
  // integers, exact for slices up to a metre, so they do not depend on the order of the triangles.
  double sum = 0, area = 0;
  for (const Triangle& t : slice.mesh.triangles) {
    const auto& p = slice.mesh.vertices;
    const auto doubled = static_cast<double>(orient2d(p[t[0]], p[t[1]], p[t[2]]));
    sum += doubled * (double{slice.hu[t[0]]} + slice.hu[t[1]] + slice.hu[t[2]]);
    area += doubled;
  }
  return area > 0 ? std::optional(sum / (3 * area)) : std::nullopt;
}

Result<nlohmann::json> parse_json_text(std::span<const std::uint8_t> text) {
  if (is_nested_too_deeply({reinterpret_cast<const char*>(text.data()), text.size()}))
    return refused("JSON nested too deeply");
  nlohmann::json parsed = parse_json(text);
  if (parsed.is_discarded()) return refused("its JSON does not parse");
  return parsed;
}

nlohmann::json trocar_extras(const nlohmann::json& extras) {
  return extras.is_object() && extras.contains("trocar") ? extras["trocar"] : nullptr;
}

Result<std::size_t> read_document_extras(const nlohmann::json& extras, Asset& asset,
                                         const std::string& name) {
  const nlohmann::json ours = trocar_extras(extras);
  const nlohmann::json schema =
      ours.is_object() ? ours.value("schema", nlohmann::json()) : nlohmann::json();
  if (schema != kAssetSchema)
    return refused(name + ": not a Trocar asset of schema " + std::to_string(kAssetSchema));
  const nlohmann::json bits = ours.value("lattice_bits", nlohmann::json());
  if (!bits.is_number_integer() || bits < kMinLatticeBits || bits > kMaxLatticeBits) {
    return refused(name + ": lattice_bits missing or out of range");
  }
  asset.lattice.bits = bits.get<int>();
  asset.parameters_json = json_text(ours.value("parameters", nlohmann::json::object()));
  const nlohmann::json digest = ours.value("input_key_digest", nlohmann::json());
  if (digest.is_string()) asset.input_key_digest = digest.get<std::string>();
  if (const auto step = ours.find("hu_step"); step != ours.end() && *step != kHuStep)
    return refused(name + ": hu_step is not " + std::to_string(kHuStep));
  const nlohmann::json materials = ours.value("materials", nlohmann::json());
  if (!materials.is_array() || materials.empty() || materials.size() > kMaxMaterials)
    return refused(name + ": no list of materials, or too many");
  asset.materials.clear();
  for (const nlohmann::json& material : materials) {
    if (!material.is_object() || !material.contains("name") || !material["name"].is_string())
      return refused(name + ": a material without a name");
    const nlohmann::json label = material.value("label", nlohmann::json());
    asset.materials.push_back({material["name"].get<std::string>(), {}});
    if (label.is_number_integer() &&
        std::abs(label.get<double>()) <= std::numeric_limits<int>::max())
      asset.materials.back().label = label.get<int>();
  }
  const nlohmann::json slices = ours.value("slices", nlohmann::json());
  if (!slices.is_number_unsigned() || slices > kMaxSlices)
    return refused(name + ": the number of its slices is missing or too large");
  return slices.get<std::size_t>();
}

Result<Eigen::Affine3d> transform_of_node(const nlohmann::json& node, const Lattice& lattice) {
  Eigen::Affine3d out = Eigen::Affine3d::Identity();
  const bool has_matrix = node.contains("matrix"), moves = node.contains("translation");
  if ((has_matrix && (moves || !are_finite_numbers(node["matrix"], 16))) ||
      (moves && !are_finite_numbers(node["translation"], 3)) || node.contains("rotation") ||
      node.contains("scale")) {
    return refused("a node without a finite translation or matrix");
  }
  if (has_matrix) {
    out.matrix() = matrix_of(node["matrix"]);
  } else if (moves) {
    for (std::size_t i = 0; i < 3; ++i)
      out.translation()[static_cast<int>(i)] = node["translation"][i].get<double>();
  }
  out.translation() *= lattice.step_mm();
  return out;
}

Result<EntryNode> entry_of_node(const nlohmann::json& node, const Lattice& lattice) {
  if (!node.is_object()) return refused("a node that is no object");
  EntryNode out;
  const auto transform = transform_of_node(node, lattice);
  if (!transform) return transform.error();
  out.transform = *transform;
  if (!node.contains("extras")) return out;
  const nlohmann::json ours = trocar_extras(node["extras"]);
  if (!ours.is_object()) return refused("a node with other extras");
  if (const auto index = ours.find("index"); index != ours.end()) {
    if (!index->is_number_integer() ||
        std::abs(index->get<double>()) > std::numeric_limits<int>::max())
      return refused("a slice index out of range");
    out.index = index->get<int>();
  }
  if (const auto z_mm = ours.find("z_mm"); z_mm != ours.end()) {
    if (!z_mm->is_number()) return refused("a node whose z_mm is no number");
    out.z_mm = z_mm->get<double>();
  }
  if (const auto mean_hu = ours.find("mean_hu"); mean_hu != ours.end()) {
    if (!mean_hu->is_array() || mean_hu->empty() || mean_hu->size() > kMaxNodeEntries ||
        !std::all_of(mean_hu->begin(), mean_hu->end(), [](const auto& n) { return n.is_number(); }))
      return refused("a node whose mean_hu is not a number for each slice");
    out.mean_hu = mean_hu->get<std::vector<double>>();
    if (out.mean_hu.size() > 1 && !out.index) return refused("a node with mean_hu and no index");
  }
  return out;
}

Eigen::Affine3d plane_of(const Eigen::Affine3d& frame, const Eigen::Affine3d& transform,
                         double z_mm) {
  Eigen::Affine3d out = Eigen::Affine3d::Identity();
  const Eigen::Vector3d origin = transform.linear().col(2) * z_mm + transform.translation();
  out.linear() = frame.linear() * transform.linear();
  out.translation() = frame.linear() * origin + frame.translation();
  return out;
}

double z_of_plane(const Eigen::Affine3d& T_lps_plane) {
  return T_lps_plane.translation().dot(T_lps_plane.linear().col(2));
}

Result<AssetSlice> slice_of_entry(const EntryNode& node, int index, int material,
                                  const Eigen::Affine3d& frame, double z_mm) {
  AssetSlice slice;
  slice.index = index;
  slice.material = material;
  slice.T_lps_plane = plane_of(frame, node.transform, z_mm);
  slice.z_mm = node.z_mm ? *node.z_mm : z_of_plane(slice.T_lps_plane);
  if (!slice.T_lps_plane.matrix().allFinite() || !std::isfinite(slice.z_mm))
    return refused("its plane is not finite");
  const std::int64_t place = node.index ? std::int64_t{index} - *node.index : 0;
  const std::size_t places = node.mean_hu.empty() ? kMaxNodeEntries : node.mean_hu.size();
  if (place < 0 || static_cast<std::size_t>(place) >= places)
    return refused("the slice index and the JSON differ");
  if (!node.mean_hu.empty())
    slice.measures_json = json_text({{"mean_hu", node.mean_hu[static_cast<std::size_t>(place)]}});
  return slice;
}

Result<PayloadFacts> decode_slice_geometry(std::span<const std::uint8_t> draco, AssetSlice& slice) {
  constexpr std::uint64_t kMax = std::numeric_limits<std::uint32_t>::max();
  auto out = decode_draco(draco, kMax, kMax);
  if (!out) return out.error();
  if (out->mesh.triangles.empty()) return refused("Draco: no triangles");
  slice.mesh = std::move(out->mesh);
  slice.hu = std::move(out->hu);
  slice.pslg = boundary_rings(slice.mesh);
  return PayloadFacts{out->z, out->has_colours};
}

Result<void> compare_geometry(const StatedEntry& stated, const AssetSlice& slice) {
  if (slice.mesh.vertices.size() != stated.vertices ||
      slice.mesh.triangles.size() != stated.triangles || stated.has_hu == slice.hu.empty())
    return refused("Draco payload and accessor counts differ");
  const auto [low, high] =
      slice.mesh.vertices.empty() ? LatticeBox{} : box_around(slice.mesh.vertices);
  if (stated.low != low || stated.high != high)
    return refused("accessor bounds differ from the vertices");
  return {};
}

Result<void> compare_lines(const StatedEntry& stated, std::span<const std::uint8_t> binary,
                           const AssetSlice& slice) {
  const auto pslg = decode_lines(stated, binary);
  if (!pslg) return pslg.error();
  if (pslg->rings != slice.pslg.rings) return refused("the lines are not the outline of its mesh");
  return {};
}

Result<DracoGrid> asset_grid(const Lattice& lattice, const LatticeBox& box) {
  const auto [low, high] = box;
  const std::int64_t max_coordinate =
      std::max({std::abs(std::int64_t{low.x}), std::abs(std::int64_t{low.y}),
                std::abs(std::int64_t{high.x}), std::abs(std::int64_t{high.y})});
  DracoGrid grid{lattice, low, 1};
  const std::int64_t span =
      std::max(std::int64_t{high.x} - grid.origin.x, std::int64_t{high.y} - grid.origin.y);
  if (span > kMaxAssetSpan || max_coordinate > kMaxAssetCoordinate) {
    return refused("the slices span " + std::to_string(std::max(span, max_coordinate)) +
                   " lattice steps; an asset holds " + std::to_string(kMaxAssetSpan) +
                   " (use a coarser lattice)");
  }
  while ((std::int64_t{1} << grid.quantization_bits) - 1 < span)
    ++grid.quantization_bits;
  return grid;
}

Result<EncodedSlice> encode_slice(const AssetSlice& slice, const DracoGrid& grid) {
  if (slice.mesh.triangles.empty()) return encode_slice(slice, {}, grid);
  const auto outline = ProvedOutline::of(slice.pslg);
  if (!outline) return bug("slice " + std::to_string(slice.index) + ": " + outline.error().message);
  return encode_slice(slice, *outline, grid);
}

// The bytes just written are decoded again: counts, bounds and proofs refer to the result.
Result<EncodedSlice> encode_slice(const AssetSlice& slice, const ProvedOutline& outline,
                                  const DracoGrid& grid) {
  const std::string where = "slice " + std::to_string(slice.index) + ": ";
  if (!parse_json(slice.measures_json).is_object())
    return bug(where + "its measures are not a JSON object");
  EncodedSlice out;
  out.index = slice.index;
  out.z_mm = slice.z_mm;
  out.T_lps_plane = slice.T_lps_plane;
  out.measures_json = slice.measures_json;
  out.material = slice.material;
  if (slice.mesh.triangles.empty()) return out;
  out.has_hu = !slice.hu.empty();
  out.has_colours = grid.colours && out.has_hu;
  auto bytes = encode_draco(slice.mesh, grid, slice.hu);
  if (!bytes) return bug(where + bytes.error().message);
  AssetSlice decoded;
  if (const auto ok = decode_slice_geometry(*bytes, decoded); !ok)
    return bug(where + "the bytes that Draco wrote do not decode: " + ok.error().message);
  const auto& [vertices, triangles] = decoded.mesh;
  if (vertices.size() != slice.mesh.vertices.size() ||
      triangles.size() != slice.mesh.triangles.size() || decoded.hu.size() != slice.hu.size()) {
    return bug(where + "Draco did not keep every vertex and triangle");
  }
  if (auto ok = check_mesh_against_outline(decoded.mesh, outline); !ok) {
    return bug(where + ok.error().message);
  }
  out.pslg = std::move(decoded.pslg);
  const auto z_at = draco_z_at(*bytes, grid);
  if (!z_at) return bug(where + z_at.error().message);
  out.draco_z_at = *z_at;
  out.draco = std::move(*bytes);
  out.vertices = vertices.size();
  out.triangles = triangles.size();
  out.bounds = box_around(vertices);
  return out;
}

}  // namespace trocar
