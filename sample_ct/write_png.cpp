// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/write_png.h"

#include <cstdlib>
#include <memory>

#include <spng.h>

#include "formats/base/files.h"
#include "formats/base/text.h"

namespace trocar::sample {

std::string png_name(int k) {
  return text_line("slice_%03d.png", k + 1);
}

namespace {

struct Freed {
  void operator()(spng_ctx* context) const { spng_ctx_free(context); }
  void operator()(std::uint8_t* bytes) const { std::free(bytes); }
};

// A PNG of `size` bytes with three bytes for each pixel; null on failure.
std::unique_ptr<std::uint8_t, Freed> encode(std::span<const std::uint8_t> pixels, int rows,
                                            int columns, std::size_t& size) {
  const std::unique_ptr<spng_ctx, Freed> png(spng_ctx_new(SPNG_CTX_ENCODER));
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(columns);
  header.height = static_cast<std::uint32_t>(rows);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  int error = png ? spng_set_option(png.get(), SPNG_ENCODE_TO_BUFFER, 1) : SPNG_EMEM;
  // On grey noise, this level packs no worse than zlib's default, and the sub filter alone no worse
  // than a filter chosen for each row. Both are faster.
  if (error == 0) error = spng_set_option(png.get(), SPNG_IMG_COMPRESSION_LEVEL, 3);
  if (error == 0) error = spng_set_option(png.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB);
  if (error == 0) error = spng_set_ihdr(png.get(), &header);
  if (error == 0)
    error = spng_encode_image(png.get(), pixels.data(), pixels.size(), SPNG_FMT_PNG,
                              SPNG_ENCODE_FINALIZE);
  if (error != 0) return nullptr;
  return std::unique_ptr<std::uint8_t, Freed>(
      static_cast<std::uint8_t*>(spng_get_png_buffer(png.get(), &size, &error)));
}

}  // namespace

Result<void> write_png(const Scan& scan, const GreyWindow& window,
                       const std::filesystem::path& folder) {
  if (!(window.high_hu > window.low_hu))
    return usage("the upper end of the grey window must be above its lower end");
  const int rows = scan.geometry.rows, columns = scan.geometry.columns;
  std::vector<std::uint8_t> grey(kMaxHu - kMinHu + 1);
  for (int hu = kMinHu; hu <= kMaxHu; ++hu) {
    const double level = (hu - window.low_hu) / (window.high_hu - window.low_hu) * 255;
    grey[hu - kMinHu] = static_cast<std::uint8_t>(std::lround(std::clamp(level, 0.0, 255.0)));
  }
  std::vector<std::uint8_t> pixels(std::size_t{3} * rows * columns);
  for (int k = 0; k < scan.geometry.slices; ++k) {
    const std::int16_t* hu = scan.slice(k);
    for (std::size_t i = 0; i < pixels.size(); i += 3, ++hu)
      std::fill_n(&pixels[i], 3, grey[*hu - kMinHu]);
    const std::filesystem::path file = folder / png_name(k);
    std::size_t size = 0;
    const auto bytes = encode(pixels, rows, columns, size);
    if (!bytes) return unwritable(file.string() + ": the PNG encoder failed");
    if (const Result<void> written = write_file_atomically(file, {bytes.get(), size}); !written)
      return written.error();
  }
  return {};
}

std::string png_library_version() {
  return std::string("libspng ") + spng_version_string();
}

}  // namespace trocar::sample
