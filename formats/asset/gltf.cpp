// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/gltf.h"

#include <limits>

#include "formats/asset/payload.h"
#include "formats/base/json.h"
#include "formats/mesh/outline_sweep.h"

namespace trocar {
namespace {

using nlohmann::json;

// glTF's numbers for component types and primitive modes.
constexpr int kUnsignedByte = 5121, kShort = 5122, kUnsignedShort = 5123, kUnsignedInt = 5125,
              kFloat = 5126;
constexpr int kLines = 1;  // triangles, 4, are the default

json numbers(const double* begin, std::size_t count) {
  json out = json::array();
  for (std::size_t i = 0; i < count; ++i)
    out.push_back(number(begin[i]));
  return out;
}

// The accessor of positions, in lattice steps, which are exact in float32.
json positions(std::size_t count, const SpacePoint& low, const SpacePoint& high) {
  return {
      {"componentType", kFloat}, {"type", "VEC3"}, {"count", count}, {"min", low}, {"max", high}};
}
json positions(std::size_t count, const LatticeBox& box, std::int32_t z) {
  return positions(count, {box.low.x, box.low.y, z}, {box.high.x, box.high.y, z});
}

using nlohmann::json;

std::size_t padded(std::size_t size) {
  return (size + 3) & ~std::size_t{3};
}

}  // namespace

json number(double value) {
  constexpr double kExact = 9007199254740992.0;  // 2^53
  if (value == std::rint(value) && std::abs(value) < kExact)
    return static_cast<std::int64_t>(value);
  return value;
}

void put_transform(const Eigen::Affine3d& T_mm, const Lattice& lattice, json& node) {
  Eigen::Affine3d steps = T_mm;
  steps.translation() /= lattice.step_mm();
  if (T_mm.linear() != Eigen::Matrix3d::Identity())
    node["matrix"] = numbers(steps.matrix().data(), 16);  // Eigen and glTF are both column-major
  else if (!T_mm.translation().isZero(0))
    node["translation"] = numbers(steps.translation().data(), 3);
}

json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, std::int32_t z,
                         AssetSizes& sizes, EntryRecord& record) {
  sizes.triangles += slice.triangles;
  sizes.triangle_bytes += slice.draco.size();
  json attributes = {{"POSITION", gltf.add_accessor(positions(slice.vertices, slice.bounds, z))}};
  json ids = {{"POSITION", kDracoPositionId}};
  const int indices = gltf.add_accessor(
      {{"componentType", kUnsignedInt}, {"type", "SCALAR"}, {"count", slice.triangles * 3}});
  if (slice.has_hu) {
    attributes[kHuAttribute] = gltf.add_accessor(
        {{"componentType", kShort}, {"type", "SCALAR"}, {"count", slice.vertices}});
    ids[kHuAttribute] = kDracoHuId;
  }
  if (slice.has_colours) {
    attributes[kColourAttribute] = gltf.add_accessor({{"componentType", kUnsignedByte},
                                                      {"normalized", true},
                                                      {"type", "VEC3"},
                                                      {"count", slice.vertices}});
    ids[kColourAttribute] = kDracoColourId;
  }
  const auto [view, range] =
      gltf.add_view(slice.draco.data(), slice.draco.size(), GltfWriter::kNoTarget);
  record.draco_offset = static_cast<std::uint32_t>(range.offset);
  record.draco_bytes = static_cast<std::uint32_t>(range.size);
  return {
      {"material", slice.material},
      {"attributes", std::move(attributes)},
      {"indices", indices},
      {"extensions", {{kDracoExtension, {{"bufferView", view}, {"attributes", std::move(ids)}}}}}};
}

json lines_primitive(GltfWriter& gltf, const Pslg& pslg, std::int32_t z, std::size_t material,
                     AssetSizes& sizes) {
  EdgeLoops loops;
  for (const Ring& ring : pslg.rings)
    loops.add(ring);
  const std::vector<LatticePoint>& points = loops.points;
  std::vector<std::uint32_t> indices;
  for (std::uint32_t i = 0; i < points.size(); ++i)
    indices.insert(indices.end(), {i, loops.next[i]});
  std::vector<float> xyz;
  xyz.reserve(points.size() * 3);
  for (LatticePoint p : points) {
    for (const std::int32_t c : {p.x, p.y, z})
      xyz.push_back(static_cast<float>(c));
  }
  const auto add = [&](json accessor, const auto& data, int target) {
    const std::size_t bytes = data.size() * sizeof data[0];
    sizes.outline_bytes += bytes;
    accessor["bufferView"] = gltf.add_view(data.data(), bytes, target).number;
    return gltf.add_accessor(accessor);
  };
  json primitive = {{"mode", kLines}, {"material", material}};
  primitive["attributes"]["POSITION"] =
      add(positions(points.size(), box_around(points), z), xyz, GltfWriter::kVertices);
  json accessor = {{"type", "SCALAR"}, {"count", indices.size()}};
  const bool narrow = points.size() < 65535;
  accessor["componentType"] = narrow ? kUnsignedShort : kUnsignedInt;
  primitive["indices"] =
      narrow ? add(accessor, std::vector<std::uint16_t>(indices.begin(), indices.end()),
                   GltfWriter::kIndices)
             : add(accessor, indices, GltfWriter::kIndices);
  return primitive;
}

// The first material has the colour of bone; each other one differs clearly from its neighbours.
json gltf_materials(const Asset& head) {
  constexpr std::array<std::array<double, 3>, 6> kColours{{{0.89, 0.85, 0.76},
                                                           {0.55, 0.7, 0.85},
                                                           {0.85, 0.55, 0.5},
                                                           {0.6, 0.8, 0.55},
                                                           {0.8, 0.65, 0.85},
                                                           {0.9, 0.8, 0.45}}};
  json out = json::array();
  for (const AssetMaterial& material : head.materials) {
    const auto& [r, g, b] = kColours[out.size() % kColours.size()];
    json one = {
        {"doubleSided", true},
        {"pbrMetallicRoughness", {{"baseColorFactor", {r, g, b, 1}}, {"metallicFactor", 0}}}};
    if (head.colours) {  // shown unchanged: neither tinted nor shaded
      one["pbrMetallicRoughness"] = {{"metallicFactor", 0}};
      one["extensions"] = {{kUnlitExtension, json::object()}};
    }
    if (head.materials.size() > 1) one["name"] = material.name;
    out.push_back(std::move(one));
  }
  if (head.lines) {
    out.push_back({{"name", "outline"},
                   {"pbrMetallicRoughness", {{"baseColorFactor", {0.55, 0.1, 0.1, 1}}}},
                   {"extensions", {{kUnlitExtension, json::object()}}}});
  }
  return out;
}

Result<int> add_surface(GltfWriter& gltf, const AssetSurface& one, AssetSizes& sizes) {
  const TriangleSurface& surface = one.surface;
  const auto draco = encode_surface(surface);
  if (!draco) return draco.error();
  const auto decoded =
      decode_surface(*draco, surface.vertices.size(), surface.triangles.size(), surface.lattice);
  if (!decoded)
    return bug("the surface that Draco wrote does not decode: " + decoded.error().message);
  if (auto ok = check_triangle_surface(*decoded); !ok) return bug(ok.error().message);
  sizes.surface_bytes += draco->size();

  const auto [low, high] = box_around(surface.vertices);
  const int position = gltf.add_accessor(positions(surface.vertices.size(), low, high));
  const int normal = gltf.add_accessor(
      {{"componentType", kFloat}, {"type", "VEC3"}, {"count", surface.vertices.size()}});
  const int indices = gltf.add_accessor({{"componentType", kUnsignedInt},
                                         {"type", "SCALAR"},
                                         {"count", surface.triangles.size() * 3}});
  const int view = gltf.add_view(draco->data(), draco->size(), GltfWriter::kNoTarget).number;
  const json ids = {{"POSITION", kDracoSurfacePositionId}, {"NORMAL", kDracoSurfaceNormalId}};
  const json primitive = {
      {"material", one.material},
      {"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
      {"indices", indices},
      {"extensions", {{kDracoExtension, {{"bufferView", view}, {"attributes", ids}}}}}};
  const int mesh = gltf.add_mesh({{"primitives", json::array({primitive})}});
  return gltf.add_node({{"mesh", mesh},
                        {"matrix", surface_matrix(surface.lattice)},
                        {"extras",
                         {{"trocar",
                           {{"surface", one.material},
                            {"lattice_bits", surface.lattice.bits},
                            {"distance_mm", one.distance_mm}}}}}});
}

int GltfWriter::Array::add(const json& element) {
  if (count > 0) text += ',';
  text += json_text(element);
  ends.push_back(text.size());
  return count++;
}

int GltfWriter::add_accessor(const nlohmann::json& accessor) {
  const auto [known, is_new] = known_accessors_.emplace(json_text(accessor), accessors_.count);
  return is_new ? accessors_.add(accessor) : known->second;
}

GltfWriter::View GltfWriter::add_view(const void* data, std::size_t size, int target) {
  if (target != kNoTarget) buffer_.resize(padded(buffer_.size()));
  const Range range{buffer_.size(), size};
  json view = {{"buffer", 0}, {"byteOffset", range.offset}, {"byteLength", size}};
  if (target != kNoTarget) view["target"] = target;
  const auto* begin = static_cast<const std::uint8_t*>(data);
  buffer_.insert(buffer_.end(), begin, begin + size);
  return {views_.add(view), range};
}

Result<GltfWriter::File> GltfWriter::finish(const json& top, const json& extras) && {
  buffer_.resize(padded(buffer_.size()));
  File out;
  std::vector<std::string> texts{json_text(top)};
  texts[0].pop_back();
  texts[0] += ",\"extras\":";
  const std::string extras_text = json_text(extras);
  out.extras = {texts[0].size(), extras_text.size()};
  texts[0] += extras_text;
  if (!buffer_.empty())
    texts.push_back(",\"buffers\":[" + json_text({{"byteLength", buffer_.size()}}) + ']');
  for (const auto& [name, array] : {std::pair{"bufferViews", &views_},
                                    {"accessors", &accessors_},
                                    {"meshes", &meshes_},
                                    {"nodes", &nodes_}}) {
    if (array->count == 0) continue;  // glTF forbids empty arrays
    texts.push_back(std::string(",\"") + name + "\":[");
    if (array == &nodes_) {
      std::uint64_t at = 0;
      for (const std::string& text : texts)
        at += text.size();
      std::size_t begin = 0;
      for (const std::size_t end : nodes_.ends) {
        out.nodes.push_back({at + begin, end - begin});
        begin = end + 1;  // skips the comma
      }
    }
    texts.push_back(std::move(array->text));
    texts.emplace_back("]");
  }
  texts.emplace_back("}");
  std::size_t json_size = 0;
  for (const std::string& text : texts)
    json_size += text.size();
  texts.back().append(padded(json_size) - json_size, ' ');
  json_size = padded(json_size);

  // https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, 4. GLB File Format Specification
  constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJson = 0x4E4F534A, kBin = 0x004E4942;
  const std::size_t size = 12 + 8 + json_size + (buffer_.empty() ? 0 : 8 + buffer_.size());
  if (size > std::numeric_limits<std::uint32_t>::max())
    return refused("an asset of more than 4 GiB; mesh fewer slices at a time");
  // Header and JSON precede the buffer. Nothing is allocated here if reserve() was sufficient.
  out.json_bytes = json_size;
  out.binary_offset = size - buffer_.size();
  out.bytes = std::move(buffer_);
  const std::size_t binary = out.bytes.size();
  out.bytes.insert(out.bytes.begin(), size - binary, 0);
  std::size_t at = 0;
  const auto put = [&out, &at](std::size_t number) {  // machine and file are little-endian
    const auto value = static_cast<std::uint32_t>(number);
    std::memcpy(out.bytes.data() + at, &value, 4);
    at += 4;
  };
  put(kMagic), put(kVersion), put(size);
  put(json_size), put(kJson);
  for (const std::string& text : texts) {
    std::memcpy(out.bytes.data() + at, text.data(), text.size());
    at += text.size();
  }
  if (binary > 0) put(binary), put(kBin);
  return out;
}

}  // namespace trocar
