// SPDX-License-Identifier: Apache-2.0
// A binary glTF 2.0 file put together piece by piece. Pieces are kept as the text and bytes that
// they will be in the file: a document tree takes many times as much, and a scan has thousands.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

class GltfWriter {
 public:
  /// glTF's buffer view targets.
  static constexpr int kNoTarget = 0, kVertices = 34962, kIndices = 34963;

  /// About how many bytes the file will have: spares it from growing by copying.
  void reserve(std::size_t bytes) { buffer_.reserve(bytes); }

  /// Bytes of the buffer, or of the JSON text.
  struct Range {
    std::uint64_t offset = 0, size = 0;
  };
  struct View {
    int number = 0;
    Range bytes;
  };
  /// 4-byte aligned.
  View add_view(const void* data, std::size_t size, int target);

  // Each gives the new piece's index.
  int add_accessor(const nlohmann::json& accessor) { return accessors_.add(accessor); }
  int add_mesh(const nlohmann::json& mesh) { return meshes_.add(mesh); }
  int add_node(const nlohmann::json& node) { return nodes_.add(node); }

  struct File {
    std::vector<std::uint8_t> bytes;
    std::size_t json_bytes = 0;     ///< of these
    std::size_t binary_offset = 0;  ///< of the buffer in `bytes`
    std::vector<Range> nodes;       ///< of the JSON text: each node's
    Range extras;                   ///< likewise
  };
  /// The file, of `top` (an object: asset, extensionsUsed, materials, scenes, ...), the document's
  /// extras and the pieces. Fails (refused) beyond the 4 GiB that its header can state.
  Result<File> finish(const nlohmann::json& top, const nlohmann::json& extras) &&;

 private:
  struct Array {
    std::string text;
    int count = 0;
    std::vector<std::size_t> ends;  ///< of each element, in `text`
    int add(const nlohmann::json& element);
  };
  Array views_, accessors_, meshes_, nodes_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace trocar
