// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/gltf_writer.h"

#include <cstring>
#include <limits>
#include <utility>

#include "formats/base/json_text.h"

namespace trocar {
namespace {

using nlohmann::json;

std::size_t padded(std::size_t size) {
  return (size + 3) & ~std::size_t{3};
}

}  // namespace

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
