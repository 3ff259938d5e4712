// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/fuzz/harness.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace trocar::fuzz {
namespace {

struct Folder {
  Folder() {
    std::error_code none;
    const std::filesystem::path memory = "/dev/shm";
    path = (std::filesystem::is_directory(memory, none) ? memory
                                                        : std::filesystem::temp_directory_path()) /
           ("trocar_fuzz_" + std::to_string(::getpid()));
    std::filesystem::create_directories(path);
  }
  ~Folder() {
    std::error_code none;
    std::filesystem::remove_all(path, none);
  }
  std::filesystem::path path;
};

}  // namespace

void fail(const std::string& what) {
  std::fprintf(stderr, "%s\n", what.c_str());
  std::abort();
}

std::filesystem::path as_file(const std::uint8_t* data, std::size_t size, const char* ending) {
  static const Folder folder;
  std::filesystem::path file = folder.path / (std::string("input") + ending);
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (descriptor < 0 || ::write(descriptor, data, size) != static_cast<ssize_t>(size))
    fail("cannot write " + file.string());
  ::close(descriptor);
  return file;
}

void expect_refusal(const Error& error) {
  if (error.code != ExitCode::kRefused) fail("not a refusal: " + error.message);
  if (error.message.size() < 10 ||
      std::any_of(error.message.begin(), error.message.end(),
                  [](char c) { return static_cast<unsigned char>(c) < 0x20; })) {
    fail("not one line: " + error.message);
  }
}

void read_all(const Result<std::unique_ptr<pipeline::SliceStack>>& stack) {
  if (!stack) return expect_refusal(stack.error());
  const pipeline::SliceStack& s = **stack;
  if (s.size() < 1 || s.width() < 1 || s.height() < 1) fail("an empty stack");
  for (int i = 0; i < std::min(s.size(), 64); ++i) {
    const pipeline::SlicePlane& p = s.plane(i);
    if (!p.T_lps_plane.matrix().allFinite() || !(p.spacing_u_mm > 0) || !(p.spacing_v_mm > 0) ||
        !std::isfinite(p.z_mm))
      fail("an invalid plane");
    if (std::abs(p.T_lps_plane.linear().determinant() - 1) > 1e-6)
      fail("a plane that is not orthonormal");
    const auto image = s.read(i);
    if (!image) {
      expect_refusal(image.error());
      continue;
    }
    if (image->width != s.width() || image->height != s.height() ||
        image->values.size() != static_cast<std::size_t>(s.width()) * s.height())
      fail("an image of another size");
    for (const float v : image->values) {
      if (!std::isfinite(v)) fail("a value that is not finite");
    }
  }
}

}  // namespace trocar::fuzz
