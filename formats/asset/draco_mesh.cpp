// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/draco_mesh.h"
#include "formats/asset/draco_settings.h"

#include <cstring>
#include <string_view>

namespace trocar {
namespace {

// Draco allocates 24 bytes for each triangle that a payload states before it reads on. These limits
// bound the memory that a few hostile bytes can allocate. Refined meshes have 0.2 to 0.4 triangles
// for each byte; a perfect grid can have a hundred, a large grid more.
constexpr std::uint64_t kMaxTrianglesPerByte = 64, kAlwaysAllowedTriangles = 1 << 22;

Result<std::vector<float>> decode_hu(const draco::Mesh& in) {
  const draco::PointAttribute* hu = in.GetAttributeByUniqueId(kDracoHuId);
  if (hu == nullptr || hu->attribute_type() != draco::GeometryAttribute::GENERIC ||
      hu->data_type() != draco::DT_INT16 || hu->num_components() != 1) {
    return refused("Draco: its second attribute is not HU");
  }
  std::vector<float> out(in.num_points());
  for (std::uint32_t v = 0; v < in.num_points(); ++v) {
    const draco::AttributeValueIndex at = hu->mapped_index(draco::PointIndex(v));
    if (at.value() >= hu->size()) return refused("Draco: attribute index out of range");
    const int value = kHuStep * hu->GetValue<std::int16_t, 1>(at)[0];
    out[v] = static_cast<float>(value);
    if (value < kMinHu || value > kMaxHu)
      return refused("Draco: HU of vertex " + std::to_string(v) + " are out of their range");
  }
  return out;
}

Result<void> check_colours(const draco::Mesh& in, const std::vector<float>& hu) {
  const draco::PointAttribute* colours = in.GetAttributeByUniqueId(kDracoColourId);
  if (colours == nullptr || colours->attribute_type() != draco::GeometryAttribute::COLOR ||
      colours->data_type() != draco::DT_UINT8 || colours->num_components() != 3)
    return refused("Draco: its third attribute is not a colour");
  for (std::uint32_t v = 0; v < in.num_points(); ++v) {
    const draco::AttributeValueIndex at = colours->mapped_index(draco::PointIndex(v));
    if (at.value() >= colours->size()) return refused("Draco: attribute index out of range");
    HuColour colour{};
    colours->GetValue(at, colour.data());
    if (colour != hu_colour(hu[v]))
      return refused("Draco: the colour of vertex " + std::to_string(v) + " is not that of its HU");
  }
  return {};
}

}  // namespace

std::uint64_t max_triangles_in(std::uint64_t bytes) {
  return std::max(kAlwaysAllowedTriangles, kMaxTrianglesPerByte * bytes);
}

// The bytes before Edgebreaker's symbols (bitstream 2.2): name, version, mesh, method, flags, kind
// of traversal, vertices and faces. Draco allocates for these two numbers without a check.
Result<void> check_draco_counts(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles) {
  constexpr std::string_view kStart("DRACO\2\2\1\1\0\0", 11);
  if (bytes.size() < kStart.size() + 1 ||
      !std::equal(kStart.begin(), kStart.end(), bytes.begin(),
                  [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; })) {
    return refused("Draco: not an Edgebreaker mesh of bitstream 2.2");
  }
  std::size_t at = kStart.size() + 1;
  const auto varint = [&bytes, &at] {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 35 && at < bytes.size(); shift += 7) {
      const std::uint8_t byte = bytes[at++];
      value |= std::uint64_t{byte & 0x7fU} << shift;
      if (byte < 0x80) break;
    }
    return value;
  };
  const std::uint64_t vertices = varint(), triangles = varint();
  if (vertices > max_vertices || triangles > max_triangles)
    return refused("Draco: more vertices or triangles than stated");
  if (triangles > max_triangles_in(bytes.size()))
    return refused("Draco: more triangles than its bytes can hold");
  return {};
}

float stored_hu(float hu) {
  const double stored = kHuStep * std::rint(static_cast<double>(hu) / kHuStep);
  return static_cast<float>(std::clamp<double>(stored, kMinHu, kMaxHu));
}

HuColour hu_colour(float hu) {
  // viridis at eighths (https://bids.github.io/colormap/), in linear light, which glTF prescribes.
  constexpr std::array<std::array<int, 3>, 9> kColours{{{15, 0, 23},
                                                        {16, 6, 50},
                                                        {11, 21, 65},
                                                        {6, 42, 69},
                                                        {4, 70, 67},
                                                        {5, 107, 55},
                                                        {27, 147, 31},
                                                        {103, 181, 8},
                                                        {250, 204, 4}}};
  constexpr int kDarkest = -200, kSteps = 32;  // HU steps from one colour to the next
  const int n = std::clamp((static_cast<int>(hu) - kDarkest) / kHuStep, 0, 8 * kSteps);
  const int left = std::min(n / kSteps, 7), share = n - left * kSteps;
  HuColour out{};
  for (std::size_t i = 0; i < 3; ++i) {
    const int a = kColours[static_cast<std::size_t>(left)][i];
    const int b = kColours[static_cast<std::size_t>(left) + 1][i];
    out[i] = static_cast<std::uint8_t>((a * (kSteps - share) + b * share + kSteps / 2) / kSteps);
  }
  return out;
}

// The payload ends with the quantisation of the position: origin, range and number of bits.
Result<std::size_t> draco_z_at(std::span<const std::uint8_t> payload, const DracoGrid& grid) {
  const std::array<float, 4> numbers{
      static_cast<float>(grid.origin.x), static_cast<float>(grid.origin.y), 0.0F,
      static_cast<float>((std::int64_t{1} << grid.quantization_bits) - 1)};
  std::array<std::uint8_t, sizeof numbers + 1> wanted{};
  std::memcpy(wanted.data(), numbers.data(), sizeof numbers);
  wanted.back() = static_cast<std::uint8_t>(grid.quantization_bits);
  if (payload.size() < wanted.size() ||
      !std::equal(wanted.begin(), wanted.end(), payload.end() - wanted.size()))
    return bug("Draco: the payload does not end with the quantisation of the position");
  return payload.size() - wanted.size() + 2 * sizeof(float);
}

Result<std::vector<std::uint8_t>> encode_draco(const SliceMesh& mesh, const DracoGrid& grid,
                                               std::span<const float> hu) {
  if (mesh.triangles.empty()) return bug("Draco: empty mesh");
  if (grid.quantization_bits < 1 || grid.quantization_bits > 24)
    return bug("Draco: " + std::to_string(grid.quantization_bits) + " quantisation bits");
  const std::int64_t max_q = (std::int64_t{1} << grid.quantization_bits) - 1;
  if (!hu.empty() && hu.size() != mesh.vertices.size())
    return bug("Draco: " + std::to_string(hu.size()) + " HU of " +
               std::to_string(mesh.vertices.size()) + " vertices");

  draco::Mesh out;
  out.set_num_points(static_cast<std::uint32_t>(mesh.vertices.size()));
  const int id = add_attribute(out, draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    const LatticePoint p = mesh.vertices[v];
    const std::int64_t qx = std::int64_t{p.x} - grid.origin.x,
                       qy = std::int64_t{p.y} - grid.origin.y;
    if (qx < 0 || qy < 0 || qx > max_q || qy > max_q) return bug("Draco: vertex outside the grid");
    const float xyz[3] = {static_cast<float>(p.x), static_cast<float>(p.y), 0.0F};
    out.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(v), xyz);
  }
  if (!hu.empty()) {
    const int hu_id = add_attribute(out, draco::GeometryAttribute::GENERIC, 1, draco::DT_INT16);
    for (std::uint32_t v = 0; v < hu.size(); ++v) {
      if (!std::isfinite(hu[v])) return bug("Draco: HU that are not finite");
      const auto steps = static_cast<std::int16_t>(stored_hu(hu[v]) / kHuStep);
      out.attribute(hu_id)->SetAttributeValue(draco::AttributeValueIndex(v), &steps);
    }
  }
  if (grid.colours && !hu.empty()) {
    const int colour_id =
        add_attribute(out, draco::GeometryAttribute::COLOR, 3, draco::DT_UINT8, true);
    for (std::uint32_t v = 0; v < hu.size(); ++v) {
      const HuColour rgb = hu_colour(stored_hu(hu[v]));
      out.attribute(colour_id)->SetAttributeValue(draco::AttributeValueIndex(v), rgb.data());
    }
  }
  set_triangles(out, mesh.triangles);

  draco::ExpertEncoder encoder(out);
  draco::Status status = configure(encoder, out, grid);
  draco::EncoderBuffer buffer;
  if (status.ok()) status = encoder.EncodeToBuffer(&buffer);
  if (!status.ok()) return bug("Draco: " + status.error_msg_string());
  return std::vector<std::uint8_t>(buffer.data(), buffer.data() + buffer.size());
}

Result<DracoSlice> decode_draco(std::span<const std::uint8_t> bytes, std::uint64_t max_vertices,
                                std::uint64_t max_triangles) {
  const auto decoded = decode_payload(bytes, max_vertices, max_triangles);
  if (!decoded) return decoded.error();
  const draco::Mesh* const in = decoded->get();
  const draco::PointAttribute* position = in->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (position == nullptr || position->data_type() != draco::DT_FLOAT32 ||
      position->num_components() != 3) {
    return refused("Draco: no float position");
  }
  if (in->num_points() > max_vertices || in->num_faces() > max_triangles)
    return refused("Draco: more vertices or triangles than stated");
  const int attributes = in->num_attributes();
  if (attributes < 1 || attributes > 3) return refused("Draco: unknown attributes");
  DracoSlice out;
  SliceMesh& mesh = out.mesh;
  mesh.vertices.resize(in->num_points());
  for (std::uint32_t v = 0; v < in->num_points(); ++v) {
    const draco::AttributeValueIndex at = position->mapped_index(draco::PointIndex(v));
    if (at.value() >= position->size()) return refused("Draco: attribute index out of range");
    std::array<std::int32_t, 3> whole{};
    std::size_t i = 0;
    for (const float c : position->GetValue<float, 3>(at)) {
      const double stored = c;
      if (!(std::abs(stored) <= kMaxCoordinate) ||
          stored != (whole[i] = static_cast<std::int32_t>(stored))) {
        return refused("Draco: vertex " + std::to_string(v) + " is off the lattice");
      }
      ++i;
    }
    if (v == 0) out.z = whole[2];
    if (out.z != whole[2]) return refused("Draco: vertices of different planes");
    mesh.vertices[v] = {whole[0], whole[1]};
  }
  mesh.triangles.resize(in->num_faces());
  for (std::uint32_t t = 0; t < in->num_faces(); ++t) {
    const draco::Mesh::Face& face = in->face(draco::FaceIndex(t));
    Triangle& triangle = mesh.triangles[t];
    for (std::size_t i = 0; i < 3; ++i) {
      triangle[i] = face[i].value();
      if (triangle[i] >= mesh.vertices.size()) return refused("Draco: index out of range");
    }
  }
  if (attributes > 1) {
    if (const auto ok = decode_hu(*in).into(out.hu); !ok) return ok.error();
  }
  out.has_colours = attributes == 3;
  if (out.has_colours) {
    if (auto ok = check_colours(*in, out.hu); !ok) return ok.error();
  }
  return out;
}

}  // namespace trocar
