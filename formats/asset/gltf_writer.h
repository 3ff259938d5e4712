// SPDX-License-Identifier: Apache-2.0
// Writes a binary glTF 2.0 file element by element. Internal to formats/. A scan has thousands of
// elements. The writer keeps them as text, because JSON values would take many times the memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

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

}  // namespace trocar
