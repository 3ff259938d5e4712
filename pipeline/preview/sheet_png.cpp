// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/sheet_png.h"

#include <sodium.h>
#include <spng.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>

namespace trocar::pipeline {
namespace {

constexpr const char* kSoftware = "trocar-mesh preview";

}  // namespace

Result<std::vector<std::uint8_t>> png_of(const Picture& picture) {
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> png(spng_ctx_new(SPNG_CTX_ENCODER),
                                                           spng_ctx_free);
  if (!png) return refused_for_now("not enough memory for the preview");
  const auto failed = [](int error) {
    return bug(std::string("the preview's PNG: ") + spng_strerror(error));
  };
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(picture.width);
  header.height = static_cast<std::uint32_t>(picture.height);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  spng_set_option(png.get(), SPNG_ENCODE_TO_BUFFER, 1);
  // Higher levels take several times as long and make files only a few per cent smaller.
  spng_set_option(png.get(), SPNG_IMG_COMPRESSION_LEVEL, 2);
  spng_set_option(png.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB);
  if (const int e = spng_set_ihdr(png.get(), &header); e != 0) return failed(e);
  std::string software = kSoftware;
  spng_text text{};
  std::strcpy(text.keyword, "Software");  // NOLINT(clang-analyzer-security.insecureAPI.strcpy)
  text.type = SPNG_TEXT;
  text.length = software.size();
  text.text = software.data();
  if (const int e = spng_set_text(png.get(), &text, 1); e != 0) return failed(e);
  if (const int e = spng_encode_image(png.get(), picture.rgb.data(), picture.rgb.size(),
                                      SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE);
      e != 0)
    return failed(e);
  std::size_t size = 0;
  int error = 0;
  const std::unique_ptr<void, void (*)(void*)> bytes(spng_get_png_buffer(png.get(), &size, &error),
                                                     std::free);
  if (!bytes) return failed(error);
  const auto* first = static_cast<const std::uint8_t*>(bytes.get());
  return std::vector<std::uint8_t>(first, first + size);
}

bool is_sheet(const std::filesystem::path& file) {
  // The text chunk precedes the pixels.
  std::string head(256, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  return head.find(std::string("tEXtSoftware") + '\0' + kSoftware) != std::string::npos;
}

std::string png_url(std::span<const std::uint8_t> png) {
  std::string out(sodium_base64_ENCODED_LEN(png.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(out.data(), out.size(), png.data(), png.size(), sodium_base64_VARIANT_ORIGINAL);
  out.pop_back();  // the final zero
  return "data:image/png;base64," + out;
}

}  // namespace trocar::pipeline
