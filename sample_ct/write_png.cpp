// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/write_png.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "formats/base/file_io.h"

namespace trocar::sample {

std::string png_name(int k) {
  std::array<char, 32> name{};
  std::snprintf(name.data(), name.size(), "slice_%03d.png", k + 1);
  return name.data();
}

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
  for (int k = 0; k < scan.geometry.slices; ++k) {
    const std::filesystem::path file = folder / png_name(k);
    std::vector<std::uint8_t> bytes;
    try {
      cv::Mat image(rows, columns, CV_8UC3);
      const std::int16_t* hu = scan.slice(k);
      for (int j = 0; j < rows; ++j)
        for (int i = 0; i < columns; ++i, ++hu)
          image.at<cv::Vec3b>(j, i) = cv::Vec3b::all(grey[*hu - kMinHu]);
      if (!cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 6}))
        return unwritable(file.string() + ": the PNG encoder failed");
    } catch (const cv::Exception& e) {
      return unwritable(file.string() + ": the PNG encoder failed: " + e.err);
    }
    if (const Result<void> written = write_file_atomically(file, bytes); !written)
      return written.error();
  }
  return {};
}

std::string png_library_version() {
  return std::string("OpenCV ") + CV_VERSION;
}

}  // namespace trocar::sample
