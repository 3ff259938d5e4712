// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/slice_stack.h"

#include <sodium.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <fstream>
#include <system_error>

#include "pipeline/read/dicom_headers.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

bool ends_with(const fs::path& file, std::initializer_list<const char*> endings) {
  std::string name = file.filename().string();
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::any_of(endings.begin(), endings.end(),
                     [&name](const char* ending) { return name.ends_with(ending); });
}

bool is_nifti(const fs::path& f) {
  return ends_with(f, {".nii", ".nii.gz"});
}
bool is_image(const fs::path& f) {
  return ends_with(f, {".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg"});
}

// slice_2 before slice_10: runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b) {
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

std::string hex_digest(crypto_generichash_state& state) {
  unsigned char hash[crypto_generichash_BYTES];
  crypto_generichash_final(&state, hash, sizeof hash);
  char hex[2 * sizeof hash + 1];
  sodium_bin2hex(hex, sizeof hex, hash, sizeof hash);
  return hex;
}

}  // namespace

bool is_scan_file(const fs::path& file) {
  return is_image(file) || is_nifti(file) || has_dicom_preamble(file);
}

Result<std::string> digest_file(const fs::path& file) {
  if (sodium_init() < 0) return bug("libsodium does not initialise");
  crypto_generichash_state state;
  crypto_generichash_init(&state, nullptr, 0, crypto_generichash_BYTES);
  std::ifstream in(file, std::ios::binary);
  if (!in) return refused(file.string() + ": cannot be opened");
  std::vector<char> block(1 << 16);
  while (in.read(block.data(), static_cast<std::streamsize>(block.size())), in.gcount() > 0) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(block.data()),
                              static_cast<unsigned long long>(in.gcount()));
  }
  if (in.bad()) return refused(file.string() + ": cannot be read");
  return hex_digest(state);
}

std::string digest_input(const std::vector<std::string>& file_digests) {
  if (file_digests.empty()) return {};
  if (file_digests.size() == 1) return file_digests[0];
  crypto_generichash_state state;
  crypto_generichash_init(&state, nullptr, 0, crypto_generichash_BYTES);
  for (const std::string& digest : file_digests) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(digest.data()),
                              digest.size());
  }
  return hex_digest(state);
}

Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<fs::path>& inputs,
                                               const OpenOptions& options) {
  if (inputs.empty()) return usage("no input given");
  std::error_code error;
  std::vector<fs::path> files;
  for (const fs::path& input : inputs) {
    const fs::file_status status = fs::status(input, error);
    if (error == std::errc::permission_denied)
      return refused(input.string() + ": " + error.message());
    if (!fs::exists(status)) return refused(input.string() + ": no such file or folder");
    if (fs::is_directory(status)) {
      if (inputs.size() > 1) return usage(input.string() + ": give one folder, or a list of files");
      fs::directory_iterator entry(input, error);
      for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
        std::error_code ignored;  // broken links are skipped, as folders are
        if (entry->is_regular_file(ignored) && entry->path().filename().string().front() != '.')
          files.push_back(entry->path());
      }
      if (error) return refused(input.string() + ": " + error.message());
    } else if (!fs::is_regular_file(status)) {
      return refused(input.string() + ": not a regular file");
    } else {
      files.push_back(input);
    }
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.string(), b.string());
  });
  if (files.empty()) return refused(inputs[0].string() + ": an empty folder");

  const bool volume = files.size() == 1 && is_nifti(files[0]);
  if (options.axis != SliceAxis::kTransverse && !volume) {
    return usage(inputs[0].string() +
                 ": --axis applies to a NIfTI volume only; images and DICOM slices keep their "
                 "planes");
  }
  const bool images = std::any_of(files.begin(), files.end(), is_image);
  if (!options.series_uid.empty() && (volume || images))
    return usage(inputs[0].string() + ": --series chooses among DICOM files; there are none");
  for (const fs::path& file : files) {
    const bool is_passed_over = images && inputs.size() == 1 && !is_image(file);
    if (!is_passed_over && ::access(file.c_str(), R_OK) != 0 && errno == EACCES)
      return refused(file.string() + ": " + std::generic_category().message(EACCES));
  }
  Result<std::unique_ptr<SliceStack>> stack = bug("no reader");
  if (volume) {
    stack = open_nifti(files[0], options);
  } else if (std::any_of(files.begin(), files.end(), is_nifti)) {
    return usage(inputs[0].string() + ": give one NIfTI file, not a folder or list with one in it");
  } else if (images) {
    // In a folder, files other than images (a README, for example) are ignored; in a list they are
    // an error.
    if (inputs.size() == 1) {
      const auto others = std::stable_partition(files.begin(), files.end(), is_image);
      const auto dicom = std::find_if(others, files.end(), has_dicom_preamble);
      if (dicom != files.end()) {
        return usage(inputs[0].string() + ": holds images (" + files[0].filename().string() +
                     ") as well as DICOM files (" + dicom->filename().string() +
                     "); give files of one kind as a list");
      }
      files.erase(others, files.end());
    }
    stack = open_images(files, options);
  } else {
    stack = open_dicom(files, options);
  }
  if (stack && (*stack)->files.empty()) (*stack)->files = std::move(files);
  return stack;
}

}  // namespace trocar::pipeline
