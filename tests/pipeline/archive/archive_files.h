// SPDX-License-Identifier: GPL-3.0-or-later
// For the tests of the archive: text files, and the bytes of a small CT image.
#pragma once

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace trocar::archive {

inline void write_text(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

inline std::string read_text(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline constexpr const char* kStudy = "2.25.1";

struct ImageText {
  std::string sop_class = UID_CTImageStorage, instance = "2.25.1.1.1", study = kStudy,
              series = "2.25.1.1";
  std::uint16_t rows = 4;
  bool has_pixels = true;
};

/// The dataset of an image of 4 columns, in explicit representation, little endian.
inline std::vector<std::uint8_t> dataset_of(const ImageText& text) {
  std::vector<std::uint8_t> out;
  const auto add = [&out](unsigned group, unsigned element, const char* representation,
                          std::string value) {
    if (value.size() % 2 != 0) value.push_back('\0');
    const bool is_long = std::string(representation) == "OW";
    for (const unsigned byte : {group & 0xffU, group >> 8U, element & 0xffU, element >> 8U})
      out.push_back(static_cast<std::uint8_t>(byte));
    out.insert(out.end(), representation, representation + 2);
    if (is_long) out.insert(out.end(), 2, 0);
    for (int k = 0; k < (is_long ? 4 : 2); ++k)
      out.push_back(static_cast<std::uint8_t>(value.size() >> (8 * k) & 0xff));
    out.insert(out.end(), value.begin(), value.end());
  };
  const auto number = [](unsigned n) {
    return std::string{static_cast<char>(n & 0xff), static_cast<char>(n >> 8)};
  };
  add(0x0008, 0x0016, "UI", text.sop_class);
  add(0x0008, 0x0018, "UI", text.instance);
  add(0x0010, 0x0010, "PN", "SECRET^NAME");
  if (!text.study.empty()) add(0x0020, 0x000d, "UI", text.study);
  add(0x0020, 0x000e, "UI", text.series);
  add(0x0028, 0x0002, "US", number(1));
  add(0x0028, 0x0010, "US", number(text.rows));
  add(0x0028, 0x0011, "US", number(4));
  add(0x0028, 0x0100, "US", number(16));
  if (text.has_pixels) add(0x7fe0, 0x0010, "OW", std::string(8U * text.rows, '\1'));
  return out;
}

}  // namespace trocar::archive
