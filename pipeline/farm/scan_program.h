// SPDX-License-Identifier: GPL-3.0-or-later
// What the farm needs to know of meshing. The program implements it; the farm itself knows files,
// keys and processes only.
#pragma once

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

/// A file or folder, and what it is to the scan: "input", or the option that names it, as "hu".
struct NamedFile {
  std::string of;
  std::filesystem::path path;
};

/// What is made of a scan's parameters.
struct Parameters {
  /// Every option that may change a byte of the outputs, with its value or default.
  nlohmann::json canonical;
  /// Files and folders that options name, in the order of the options' names.
  std::vector<NamedFile> files;
};

/// A scan's asset and report. The report is a function of bytes of the files and of the canonical
/// parameters: no times, no paths.
struct Product {
  std::vector<std::uint8_t> asset;
  std::string report;
  nlohmann::json warnings;  ///< all, for people: they may name files
};

class OpenedScan {
 public:
  OpenedScan() = default;
  OpenedScan(const OpenedScan&) = delete;
  OpenedScan& operator=(const OpenedScan&) = delete;
  virtual ~OpenedScan() = default;
  /// The files that the scan consists of, in the order that matters.
  virtual std::vector<NamedFile> files() const = 0;
  virtual Result<Product> mesh() = 0;
};

class ScanProgram {
 public:
  ScanProgram() = default;
  ScanProgram(const ScanProgram&) = delete;
  ScanProgram& operator=(const ScanProgram&) = delete;
  virtual ~ScanProgram() = default;
  /// Parameters as a collection gives them: names of options and their values. Errors: (usage)
  /// wrong ones, (refused) a file that they name.
  virtual Result<Parameters> parameters(const nlohmann::json& given) const = 0;
  /// Whether the scan has to be opened before its key is known: which of a folder's files it
  /// consists of, or whether its parameters are for it, is not known before.
  virtual bool opens_first(const std::vector<std::filesystem::path>& inputs,
                           const Parameters& parameters) const = 0;
  /// `inputs`: files, or one folder. The errors' messages name paths as they are given here.
  virtual Result<std::unique_ptr<OpenedScan>> open(const nlohmann::json& given,
                                                   const std::vector<std::filesystem::path>& inputs,
                                                   const std::string& series,
                                                   int threads) const = 0;
};

}  // namespace trocar::farm
