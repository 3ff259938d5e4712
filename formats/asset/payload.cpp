// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/payload.h"

#include <limits>

#include "formats/asset/draco_settings.h"
#include "formats/base/json.h"

namespace trocar {
namespace {

// The box of vertices at one height, from the bounds of positions.
struct Box {
  LatticePoint low, high;
  std::int32_t z = 0;
};
Result<Box> box_of(const tinygltf::Accessor& position) {
  const std::vector<double>&low = position.minValues, &high = position.maxValues;
  if (low.size() != 3 || high.size() != 3 || low[2] != high[2])
    return refused("accessor without bounds in the plane");
  std::array<std::int32_t, 5> steps{};
  const std::array bounds{low[0], low[1], high[0], high[1], low[2]};
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const double c = bounds[i];
    if (!(std::abs(c) <= kMaxCoordinate) || c != std::rint(c))
      return refused("accessor bounds are off the lattice");
    steps[i] = static_cast<std::int32_t>(c);
  }
  return Box{{steps[0], steps[1]}, {steps[2], steps[3]}, steps[4]};
}

// Does the accessor have one element of this type for each vertex, under this Draco id?
bool is_per_vertex(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                   const char* attribute, int component, int type, std::uint32_t id,
                   std::size_t vertices) {
  const tinygltf::Accessor* accessor = attribute_of(model, primitive, attribute);
  return accessor != nullptr && accessor->componentType == component && accessor->type == type &&
         accessor->count == vertices && draco_id(primitive, attribute) == static_cast<int>(id);
}

// Sets which attributes beside the position the payload has.
Result<void> state_attributes(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                              StatedEntry& stated) {
  const std::size_t vertices = stated.vertices;
  if (draco_id(primitive, "POSITION") != static_cast<int>(kDracoPositionId))
    return refused("its position has another Draco id");
  stated.has_hu = primitive.attributes.contains(kHuAttribute);
  if (!stated.has_hu) return {};
  if (!is_per_vertex(model, primitive, kHuAttribute, TINYGLTF_COMPONENT_TYPE_SHORT,
                     TINYGLTF_TYPE_SCALAR, kDracoHuId, vertices))
    return refused("HU that are not one for each vertex");
  stated.has_colours = primitive.attributes.contains(kColourAttribute);
  if (stated.has_colours &&
      !(is_per_vertex(model, primitive, kColourAttribute, TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE,
                      TINYGLTF_TYPE_VEC3, kDracoColourId, vertices) &&
        attribute_of(model, primitive, kColourAttribute)->normalized))
    return refused("colours that are not one for each vertex");
  return {};
}

Result<void> state_triangles(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                             const Asset& asset, StatedEntry& stated) {
  EntryRecord& record = stated.record;
  const auto draco = draco_primitive(model, primitive);
  if (!draco) return draco.error();
  record.draco_offset = draco->offset;
  record.draco_bytes = static_cast<std::uint32_t>(draco->payload.size());
  stated.vertices = draco->vertices;
  stated.triangles = draco->triangles;
  const auto box = box_of(*draco->position);
  if (!box) return box.error();
  stated.low = box->low;
  stated.high = box->high;
  stated.z = box->z;
  if (element_at(asset.materials, primitive.material) == nullptr)
    return refused("its material is not in the list");
  record.material = static_cast<std::uint16_t>(primitive.material);
  return state_attributes(model, primitive, stated);
}

Result<void> state_lines(const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                         StatedEntry& stated) {
  const tinygltf::Accessor* position = attribute_of(model, primitive, "POSITION");
  const tinygltf::Accessor* index = element_at(model.accessors, primitive.indices);
  if (position == nullptr || index == nullptr ||
      position->componentType != TINYGLTF_COMPONENT_TYPE_FLOAT ||
      position->type != TINYGLTF_TYPE_VEC3 || index->type != TINYGLTF_TYPE_SCALAR) {
    return refused("outline without positions or indices");
  }
  const bool narrow = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
  const bool wide = index->componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
  stated.segment_index_bytes = narrow ? 2 : 4;
  const auto points = packed_view(model, *position, 3 * sizeof(float));
  const auto segments = packed_view(model, *index, stated.segment_index_bytes);
  if (!points || !segments || !(narrow || wide) || index->count != 2 * position->count)
    return refused("outline data outside the buffer or of the wrong size");
  stated.outline_offset = offset_of(model, *points);
  stated.outline_vertices = static_cast<std::uint32_t>(position->count);
  stated.segments_offset = offset_of(model, *segments);
  return {};
}

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
    if (indices[2 * i] != i || (to != i + 1 && to != first) || (to == first && ring.size() < 3))
      return refused("outline segment " + std::to_string(i) + " does not continue its ring");
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

constexpr int kNormalBits = 8;

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

Result<std::vector<StatedEntry>> stated_entries(const tinygltf::Model& model,
                                                const tinygltf::Node& node, int first_index,
                                                const Asset& asset) {
  std::vector<StatedEntry> out(1);
  out[0].record.index = first_index;
  if (node.mesh < 0) return out;
  const auto at = [&out] { return "slice " + std::to_string(out.back().record.index) + ": "; };
  const tinygltf::Mesh* const mesh = element_at(model.meshes, node.mesh);
  if (mesh == nullptr) return refused(at() + "mesh index out of range");
  const std::vector<tinygltf::Primitive>& primitives = mesh->primitives;
  const auto has_mode = [&primitives](std::size_t i, int mode) {
    return i < primitives.size() && primitives[i].mode == mode;
  };
  if (primitives.empty()) return refused(at() + "expected one triangles and one lines primitive");
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    if (i > 0) {
      if (out.size() == kMaxNodeEntries ||
          out.back().record.index == std::numeric_limits<int>::max())
        return refused(at() + "too many slices in its node");
      const int next = out.back().record.index + 1;
      out.emplace_back().record.index = next;
    }
    StatedEntry& stated = out.back();
    if (!has_mode(i, TINYGLTF_MODE_TRIANGLES))
      return refused(at() + "expected one triangles and one lines primitive");
    if (auto ok = state_triangles(model, primitives[i], asset, stated); !ok)
      return refused(at() + ok.error().message);
    stated.has_lines = has_mode(i + 1, TINYGLTF_MODE_LINE);
    if (!stated.has_lines) continue;
    if (auto ok = state_lines(model, primitives[++i], stated); !ok)
      return refused(at() + ok.error().message);
  }
  return out;
}

std::size_t count_entries(const tinygltf::Model& model, const std::vector<int>& nodes) {
  std::size_t count = 0;
  for (const int number : nodes) {
    const tinygltf::Node* const node = element_at(model.nodes, number);
    const auto* const mesh = node == nullptr ? nullptr : element_at(model.meshes, node->mesh);
    if (mesh == nullptr) {
      ++count;
      continue;
    }
    count += static_cast<std::size_t>(std::count_if(
        mesh->primitives.begin(), mesh->primitives.end(),
        [](const tinygltf::Primitive& p) { return p.mode == TINYGLTF_MODE_TRIANGLES; }));
  }
  return count;
}

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
  if (!bits.is_number_integer() || bits < kMinLatticeBits || bits > kMaxLatticeBits)
    return refused(name + ": lattice_bits missing or out of range");
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
  if (const auto ok = transform_of_node(node, lattice).into(out.transform); !ok) return ok.error();
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
  if (auto ok = check_mesh_against_outline(decoded.mesh, outline); !ok)
    return bug(where + ok.error().message);
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

Result<std::vector<std::uint8_t>> encode_surface(const TriangleSurface& surface) {
  if (auto ok = check_triangle_surface(surface); !ok) return bug(ok.error().message);
  const auto vertices = static_cast<std::uint32_t>(surface.vertices.size());
  std::array<float, 3> low{};
  std::int64_t extent = 1;
  const auto [lowest, highest] = box_around(surface.vertices);
  for (std::size_t k = 0; k < 3; ++k) {
    low[k] = static_cast<float>(lowest[k]);
    extent = std::max(extent, std::int64_t{highest[k]} - lowest[k]);
  }
  int bits = 1;
  while ((std::int64_t{1} << bits) - 1 < extent)
    ++bits;
  // Draco's float arithmetic is exact as long as all numbers fit a float's 24 bits.
  if (bits > 24) return refused("the surface has more lattice steps than an asset holds");

  draco::Mesh mesh;
  mesh.set_num_points(vertices);
  const int position =
      add_attribute(mesh, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = add_attribute(mesh, draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const std::vector<Eigen::Vector3f> normals = vertex_normals(surface);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    const SpacePoint& p = surface.vertices[v];
    const std::array<float, 3> xyz{static_cast<float>(p[0]), static_cast<float>(p[1]),
                                   static_cast<float>(p[2])};
    mesh.attribute(position)->SetAttributeValue(draco::AttributeValueIndex(v), xyz.data());
    mesh.attribute(normal)->SetAttributeValue(draco::AttributeValueIndex(v), normals[v].data());
  }
  set_triangles(mesh, surface.triangles);
  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(2, 2);
  encoder.SetAttributeExplicitQuantization(position, bits, 3, low.data(),
                                           static_cast<float>((std::int64_t{1} << bits) - 1));
  encoder.SetAttributeQuantization(normal, kNormalBits);
  draco::EncoderBuffer buffer;
  if (const draco::Status status = encoder.EncodeToBuffer(&buffer); !status.ok())
    return bug("Draco: " + status.error_msg_string());
  return std::vector<std::uint8_t>(buffer.data(), buffer.data() + buffer.size());
}

Result<TriangleSurface> decode_surface(std::span<const std::uint8_t> bytes, std::uint64_t vertices,
                                       std::uint64_t triangles, const Lattice& lattice) {
  const auto decoded = decode_payload(bytes, vertices, triangles);
  if (!decoded) return decoded.error();
  const draco::Mesh* const in = decoded->get();
  const draco::PointAttribute* position = in->GetAttributeByUniqueId(kDracoSurfacePositionId);
  const draco::PointAttribute* normal = in->GetAttributeByUniqueId(kDracoSurfaceNormalId);
  if (in->num_attributes() != 2 || position == nullptr || normal == nullptr ||
      position->attribute_type() != draco::GeometryAttribute::POSITION ||
      normal->attribute_type() != draco::GeometryAttribute::NORMAL ||
      position->data_type() != draco::DT_FLOAT32 || position->num_components() != 3) {
    return refused("Draco: not the positions and normals of a surface");
  }
  if (in->num_points() != vertices || in->num_faces() != triangles)
    return refused("Draco: other numbers of vertices or triangles than stated");
  TriangleSurface out;
  out.lattice = lattice;
  out.vertices.reserve(in->num_points());
  for (std::uint32_t v = 0; v < in->num_points(); ++v) {
    std::array<float, 3> xyz{};
    const draco::AttributeValueIndex at = position->mapped_index(draco::PointIndex(v));
    if (at.value() >= position->size()) return refused("Draco: attribute index out of range");
    position->GetValue(at, xyz.data());
    SpacePoint p{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (!(std::abs(xyz[k]) <= static_cast<float>(kMaxSpaceCoordinate)) ||
          xyz[k] != std::rint(xyz[k]))
        return refused("Draco: vertex " + std::to_string(v) + " is off the lattice");
      p[k] = static_cast<std::int32_t>(xyz[k]);
    }
    out.vertices.push_back(p);
  }
  out.triangles.reserve(in->num_faces());
  for (std::uint32_t t = 0; t < in->num_faces(); ++t) {
    const draco::Mesh::Face& face = in->face(draco::FaceIndex(t));
    for (std::size_t i = 0; i < 3; ++i)
      if (face[i].value() >= out.vertices.size()) return refused("Draco: index out of range");
    out.triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return out;
}

std::array<double, 16> surface_matrix(const Lattice& lattice) {
  const double step = lattice.step_m();
  return {step, 0, 0, 0, 0, 0, -step, 0, 0, step, 0, 0, 0, 0, 0, 1};
}

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
