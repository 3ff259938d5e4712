// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/file_names.h"

#include <sodium.h>
#include <algorithm>
#include <cctype>
#include <cerrno>
#include <fstream>

#include "formats/base/files.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

std::string lower_name(const fs::path& file) {
  return lower(file.filename().string());
}

std::string hex_digest(crypto_generichash_state& state) {
  unsigned char hash[crypto_generichash_BYTES];
  crypto_generichash_final(&state, hash, sizeof hash);
  char hex[2 * sizeof hash + 1];
  sodium_bin2hex(hex, sizeof hex, hash, sizeof hash);
  return hex;
}

}  // namespace

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

bool has_ending(const fs::path& file, std::initializer_list<const char*> endings) {
  const std::string name = lower_name(file);
  return std::any_of(endings.begin(), endings.end(),
                     [&name](const char* ending) { return name.ends_with(ending); });
}

bool is_nifti(const fs::path& file) {
  return has_ending(file, {".nii", ".nii.gz"});
}
bool is_nrrd(const fs::path& file) {
  return has_ending(file, {".nrrd", ".nhdr"});
}
bool is_volume(const fs::path& file) {
  return is_nifti(file) || is_nrrd(file);
}
std::string format_of_volumes(const std::vector<fs::path>& files) {
  if (std::none_of(files.begin(), files.end(), is_nrrd)) return "NIfTI";
  return std::all_of(files.begin(), files.end(), is_nrrd) ? "NRRD" : "NIfTI or NRRD";
}
bool is_image(const fs::path& file) {
  return has_ending(file, {".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg"});
}
bool is_dicomdir(const fs::path& file) {
  return lower_name(file) == "dicomdir";
}
bool is_left_by_system(const fs::path& file) {
  const std::string name = lower_name(file);
  return is_dicomdir(file) || name == "thumbs.db" || name == "desktop.ini";
}

bool natural_less(const fs::path& one, const fs::path& other) {
  const std::string &a = one.native(), &b = other.native();
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (digit(a[i]) && digit(b[j])) {
      const auto number = [&digit](const std::string& s, std::size_t& k) {
        while (k < s.size() && s[k] == '0')
          ++k;
        const std::size_t first = k;
        while (k < s.size() && digit(s[k]))
          ++k;
        return s.substr(first, k - first);
      };
      const std::string m = number(a, i), n = number(b, j);
      if (m.size() != n.size()) return m.size() < n.size();
      if (m != n) return m < n;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
    }
  }
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

Error choose_one(const std::string& where, const std::string& what,
                 const std::vector<fs::path>& these) {
  constexpr std::size_t kMax = 8;
  std::string names;
  for (std::size_t i = 0; i < std::min(these.size(), kMax); ++i)
    names += (i == 0 ? "" : ", ") + these[i].string();
  if (these.size() > kMax) names += " and " + std::to_string(these.size() - kMax) + " more";
  return usage(where + ": holds " + std::to_string(these.size()) + " " + what +
               ", give one of them: " + names);
}

Result<std::string> digest_file(const std::filesystem::path& file) {
  if (sodium_init() < 0) return bug("libsodium does not initialise");
  crypto_generichash_state state;
  crypto_generichash_init(&state, nullptr, 0, crypto_generichash_BYTES);
  std::ifstream in(file, std::ios::binary);
  if (!in) return refused_by_system(file.string(), errno);
  std::vector<char> block(1 << 16);
  while (in.read(block.data(), static_cast<std::streamsize>(block.size())), in.gcount() > 0) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(block.data()),
                              static_cast<unsigned long long>(in.gcount()));
  }
  if (in.bad()) return refused_for_now(file.string() + ": cannot be read");
  return hex_digest(state);
}

std::string digest_input(const std::vector<std::string>& file_digests,
                         const std::vector<std::uint8_t>& key) {
  static_assert(kMinKeyBytes == crypto_generichash_KEYBYTES_MIN &&
                kMaxKeyBytes == crypto_generichash_KEYBYTES_MAX);
  crypto_generichash_state state;
  crypto_generichash_init(&state, key.data(), key.size(), crypto_generichash_BYTES);
  for (const std::string& digest : file_digests) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(digest.data()),
                              digest.size());
  }
  return hex_digest(state);
}

}  // namespace trocar::pipeline
