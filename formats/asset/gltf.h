// SPDX-License-Identifier: Apache-2.0
// Writes the glTF elements of an asset.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/base/result.h"

namespace trocar {

// Writes a binary glTF 2.0 file element by element. Internal to formats/. A scan has thousands of
// elements. The writer keeps them as text, because JSON values would take many times the memory.

class GltfWriter {
 public:
  /// glTF's buffer view targets.
  static constexpr int kNoTarget = 0, kVertices = 34962, kIndices = 34963;

  /// Reserves memory for about this many bytes, which saves copies while the buffer grows.
  void reserve(std::size_t bytes) { buffer_.reserve(bytes); }

  /// A range of bytes in the buffer or in the JSON text.
  struct Range {
    std::uint64_t offset = 0, size = 0;
  };
  /// Appends bytes that no buffer view covers.
  void add_bytes(const std::vector<std::uint8_t>& bytes) {
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  }
  struct View {
    int number = 0;
    Range bytes;
  };
  /// Appends data and a buffer view that covers the data. Data with a target are aligned to 4
  /// bytes. Data without a target (kNoTarget) are not aligned, because no GPU reads them.
  View add_view(const void* data, std::size_t size, int target);

  // Each function adds an element and returns its index. For an accessor that exists already,
  // add_accessor() returns the index of the existing one: accessors of Draco payloads are often
  // equal.
  int add_accessor(const nlohmann::json& accessor);
  int add_mesh(const nlohmann::json& mesh) { return meshes_.add(mesh); }
  int add_node(const nlohmann::json& node) { return nodes_.add(node); }

  struct File {
    std::vector<std::uint8_t> bytes;
    std::size_t json_bytes = 0;     ///< size of the JSON text
    std::size_t binary_offset = 0;  ///< offset of the buffer in `bytes`
    std::vector<Range> nodes;       ///< location of each node in the JSON text
    Range extras;                   ///< location of the document's extras in the JSON text
  };
  /// Returns the file, made of `top`, the document's extras and the elements. `top` is an object
  /// with all other members of the document, such as asset, extensionsUsed, materials and scenes.
  /// Errors: kRefused if the file would exceed 4 GiB, the largest size that a .glb can have.
  Result<File> finish(const nlohmann::json& top, const nlohmann::json& extras) &&;

 private:
  struct Array {
    std::string text;
    int count = 0;
    std::vector<std::size_t> ends;  ///< end of each element in `text`
    int add(const nlohmann::json& element);
  };
  Array views_, accessors_, meshes_, nodes_;
  std::map<std::string, int> known_accessors_;
  std::vector<std::uint8_t> buffer_;
};

// The glTF elements of an asset: primitives, materials, transforms and nodes of surfaces. Internal
// to formats/.

inline constexpr const char* kUnlitExtension = "KHR_materials_unlit";

/// A number for the JSON text. A whole number is written without ".0", which is shorter.
nlohmann::json number(double value);
/// Writes a transform into `node`: a pure translation as `translation`, any other transform as
/// `matrix`. The identity is not written. Lengths are in mm in `T_mm` and in lattice steps in the
/// node's JSON.
void put_transform(const Eigen::Affine3d& T_mm, const Lattice& lattice, nlohmann::json& node);

/// Returns the primitive of a slice's triangles, which lie at a height of z steps. Adds the Draco
/// payload and the accessors to `gltf`, counts the triangles and the payload's bytes in `sizes`,
/// and stores the payload's location in `record`.
nlohmann::json triangles_primitive(GltfWriter& gltf, const EncodedSlice& slice, std::int32_t z,
                                   AssetSizes& sizes, EntryRecord& record);
/// Returns a primitive that shows an outline as lines, for viewers. Adds the lines to `gltf` and
/// counts their bytes in `sizes`. `material` is the number of the glTF material of outlines.
nlohmann::json lines_primitive(GltfWriter& gltf, const Pslg& pslg, std::int32_t z,
                               std::size_t material, AssetSizes& sizes);
/// Returns the glTF materials: one for each material of the asset and, if the file holds outlines
/// as lines, one for the outlines.
nlohmann::json gltf_materials(const Asset& head);
/// Adds a surface and returns the number of its node. All slices are below node 0. The surface's
/// node is not, so readers of slices ignore the surface. Errors: those of encode_surface(); kBug if
/// the payload does not decode to a valid surface.
Result<int> add_surface(GltfWriter& gltf, const AssetSurface& one, AssetSizes& sizes);

}  // namespace trocar
