// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/image/jpeg2000.h"

#include <openjpeg.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace trocar::pipeline {
namespace {

// The state of an OpenJPEG stream over bytes in memory.
struct Memory {
  std::span<const std::uint8_t> bytes;
  std::size_t at = 0;
};

OPJ_SIZE_T read_bytes(void* to, OPJ_SIZE_T count, void* user) {
  auto& m = *static_cast<Memory*>(user);
  const std::size_t n = std::min<std::size_t>(count, m.bytes.size() - m.at);
  if (n == 0) return static_cast<OPJ_SIZE_T>(-1);
  std::memcpy(to, m.bytes.data() + m.at, n);
  m.at += n;
  return n;
}

OPJ_BOOL seek_to(OPJ_OFF_T place, void* user) {
  auto& m = *static_cast<Memory*>(user);
  if (place < 0 || static_cast<std::size_t>(place) > m.bytes.size()) return OPJ_FALSE;
  m.at = static_cast<std::size_t>(place);
  return OPJ_TRUE;
}

OPJ_OFF_T skip_bytes(OPJ_OFF_T count, void* user) {
  auto& m = *static_cast<Memory*>(user);
  return seek_to(static_cast<OPJ_OFF_T>(m.at) + count, user) ? count : -1;
}

// OpenJPEG allocates tiles as soon as it has read the header, so their number is checked before
// that. SIZ is always the first marker segment, and its fields are at fixed offsets (ISO 15444-1,
// A.5.1).
bool has_expected_size(std::span<const std::uint8_t> c, int width, int height) {
  const auto u32 = [&c](std::size_t at) {
    return static_cast<std::uint32_t>(c[at]) << 24 | static_cast<std::uint32_t>(c[at + 1]) << 16 |
           static_cast<std::uint32_t>(c[at + 2]) << 8 | c[at + 3];
  };
  if (c.size() < 42 || c[0] != 0xff || c[1] != 0x4f || c[2] != 0xff || c[3] != 0x51) return false;
  const std::uint32_t tile_x = u32(24), tile_y = u32(28);
  if (u32(8) != static_cast<std::uint32_t>(width) || u32(12) != static_cast<std::uint32_t>(height))
    return false;
  if (u32(16) != 0 || u32(20) != 0 || u32(32) != 0 || u32(36) != 0 || tile_x == 0 || tile_y == 0)
    return false;
  const std::uint64_t across = (static_cast<std::uint64_t>(width) + tile_x - 1) / tile_x;
  const std::uint64_t down = (static_cast<std::uint64_t>(height) + tile_y - 1) / tile_y;
  return across * down <= 4096 && c[40] == 0 && c[41] == 1;
}

}  // namespace

Result<Jpeg2000> decode_jpeg2000(std::span<const std::uint8_t> codestream, int width, int height,
                                 const std::string& name) {
  if (!has_expected_size(codestream, width, height)) {
    return refused(name + ": not a JPEG 2000 codestream of one component of " +
                   std::to_string(width) + " x " + std::to_string(height));
  }
  const std::unique_ptr<opj_codec_t, void (*)(opj_codec_t*)> codec(
      opj_create_decompress(OPJ_CODEC_J2K), opj_destroy_codec);
  Memory memory{codestream};
  const std::unique_ptr<opj_stream_t, void (*)(opj_stream_t*)> stream(
      opj_stream_create(1 << 16, OPJ_TRUE), opj_stream_destroy);
  if (!codec || !stream) return refused_for_now(name + ": not enough memory to decode JPEG 2000");
  opj_stream_set_user_data(stream.get(), &memory, nullptr);
  opj_stream_set_user_data_length(stream.get(), codestream.size());
  opj_stream_set_read_function(stream.get(), read_bytes);
  opj_stream_set_skip_function(stream.get(), skip_bytes);
  opj_stream_set_seek_function(stream.get(), seek_to);
  opj_dparameters_t parameters;
  opj_set_default_decoder_parameters(&parameters);
  opj_image_t* raw = nullptr;
  const bool has_header = opj_setup_decoder(codec.get(), &parameters) &&
                          opj_decoder_set_strict_mode(codec.get(), OPJ_TRUE) &&
                          opj_read_header(stream.get(), codec.get(), &raw);
  const std::unique_ptr<opj_image_t, void (*)(opj_image_t*)> image(raw, opj_image_destroy);
  const auto fits = [&] {
    return image->numcomps == 1 && image->comps[0].w == static_cast<OPJ_UINT32>(width) &&
           image->comps[0].h == static_cast<OPJ_UINT32>(height) && image->comps[0].prec <= 16;
  };
  if (!has_header || !image || !fits())
    return refused(name + ": its JPEG 2000 header is damaged or of more than 16 bits");
  if (!opj_decode(codec.get(), stream.get(), image.get()) ||
      !opj_end_decompress(codec.get(), stream.get()) || !fits() ||
      image->comps[0].data == nullptr) {
    return refused(name + ": its JPEG 2000 data is damaged or truncated");
  }
  const opj_image_comp_t& samples = image->comps[0];
  Jpeg2000 out;
  out.samples.assign(samples.data, samples.data + static_cast<std::size_t>(width) * height);
  out.is_signed = samples.sgnd != 0;
  return out;
}

}  // namespace trocar::pipeline
