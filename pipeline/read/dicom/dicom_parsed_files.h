// SPDX-License-Identifier: GPL-3.0-or-later
// A cache of parsed multi-frame DICOM files, so that a file is not parsed again for each frame.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::pipeline {

/// Keeps the parsed multi-frame files that no thread is using. A thread calls take() to get the
/// file of a frame, reads the frame, and calls give_back(). Before take() parses a file, it drops
/// an unused one, so there are never more parsed files than threads. Thread-safe. Errors of take():
/// kRefused if the file cannot be parsed.
class ParsedFiles {
 public:
  Result<std::unique_ptr<DcmFileFormat>> take(const DicomFrame& h) {
    {
      const std::lock_guard lock(mutex_);
      for (auto it = idle_.begin(); it != idle_.end(); ++it) {
        if (it->first != h.file) continue;
        auto out = std::move(it->second);
        idle_.erase(it);
        return out;
      }
      if (!idle_.empty()) idle_.erase(idle_.begin());
    }
    auto format = std::make_unique<DcmFileFormat>();
    if (load_dicom(h.file, *format).bad()) return refused(h.name() + ": cannot be read");
    return format;
  }
  void give_back(const DicomFrame& h, std::unique_ptr<DcmFileFormat> format) {
    if (h.frames == 1) return;
    const std::lock_guard lock(mutex_);
    idle_.emplace_back(h.file, std::move(format));
  }

 private:
  std::mutex mutex_;
  std::vector<std::pair<std::filesystem::path, std::unique_ptr<DcmFileFormat>>> idle_;
};

}  // namespace trocar::pipeline
