// SPDX-License-Identifier: GPL-3.0-or-later
// DICOM files carry their position: the order in which they are given and their names do not change
// the stack.
#include <filesystem>
#include <random>
#include <string>

#include "pipeline/open/open_stack.h"
#include "pipeline/read/dicom/dicom_stack.h"
#include "pipeline/read/slice_stack.h"
#include "sample_ct/write_dicom.h"
#include "tests/properties/property_fixture.h"
#include "tests/support/temporary_folder.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

/// A folder with seven DICOM slices of noise.
class Folder {
 public:
  Folder() {
    sample::Scan scan;
    scan.geometry = *sample::sample_geometry(32, 7);
    for (int i = 0; i < 32 * scan.geometry.rows * 7; ++i)
      scan.hu.push_back(static_cast<std::int16_t>((i * 7919) % 3000 - 1000));
    fs::create_directories(path() / "scan");
    if (!sample::write_dicom(scan, path() / "scan")) std::abort();
    for (const auto& entry : fs::directory_iterator(path() / "scan"))
      files_.push_back(entry.path());
    std::sort(files_.begin(), files_.end());
  }
  const fs::path& path() const { return folder_.path(); }
  const std::vector<fs::path>& files() const { return files_; }

 private:
  test::TemporaryFolder folder_;
  std::vector<fs::path> files_;
};

const Folder& folder() {
  static const Folder made;
  return made;
}

void expect_same(const SliceStack& one, const SliceStack& other) {
  RC_ASSERT(one.size() == other.size());
  for (int k = 0; k < one.size(); ++k) {
    RC_ASSERT(one.plane(k).z_mm == other.plane(k).z_mm);
    const bool same_plane =
        one.plane(k).T_lps_plane.matrix() == other.plane(k).T_lps_plane.matrix();
    RC_ASSERT(same_plane);
    const auto a = one.read(k), b = other.read(k);
    const bool both = a && b;
    RC_ASSERT(both);
    const bool same_values = a->values == b->values;
    RC_ASSERT(same_values);
  }
}

std::vector<std::size_t> any_order(std::size_t n) {
  std::mt19937_64 random(test::any_seed());
  std::vector<std::size_t> out(n);
  for (std::size_t i = 0; i < n; ++i)
    out[i] = i;
  for (std::size_t i = n; i > 1; --i)
    std::swap(out[i - 1], out[random() % i]);
  return out;
}

RC_GTEST_PROP(Order, OfAListOfDicomFilesDoesNotMatter, ()) {
  std::vector<fs::path> files;
  for (const std::size_t i : any_order(folder().files().size()))
    files.push_back(folder().files()[i]);
  const auto there = open_dicom(files, {}), here = open_dicom(folder().files(), {});
  const bool both = here && there;
  RC_ASSERT(both);
  expect_same(**here, **there);
}

RC_GTEST_PROP(Order, OfNamesInAFolderDoesNotMatter, ()) {
  const fs::path renamed = folder().path() / "renamed";
  fs::remove_all(renamed);
  fs::create_directories(renamed);
  const std::vector<std::size_t> order = any_order(folder().files().size());
  for (std::size_t i = 0; i < order.size(); ++i)
    fs::create_hard_link(folder().files()[i], renamed / std::to_string(order[i]));
  const auto there = open_stack({renamed}, {}), here = open_stack({folder().path() / "scan"}, {});
  const bool both = here && there;
  RC_ASSERT(both);
  expect_same(**here, **there);
}

}  // namespace
}  // namespace trocar::pipeline
