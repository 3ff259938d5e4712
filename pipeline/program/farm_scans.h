// SPDX-License-Identifier: GPL-3.0-or-later
// Opens and meshes the scans of `trocar-mesh batch`, through the interface farm/scan_program.h.
// The parameters of a scan in a collection are options of trocar-mesh. The parser of the command
// line reads them.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/farm/scan_program.h"

namespace trocar::pipeline {

class FarmScans : public farm::ScanProgram {
 public:
  /// `digest`: SHA-256 of the executable that meshes.
  explicit FarmScans(std::string digest = "") : digest_(std::move(digest)) {}
  const std::string& digest() const override { return digest_; }
  /// Errors: kUsage if `given` names an option that trocar-mesh does not have, or one that a
  /// collection must not give; otherwise the errors of the same options on the command line.
  Result<farm::Parameters> parameters(const nlohmann::json& given) const override;
  /// False if all inputs, the CT of --hu and the mask, if given, are NIfTI files, because the paths
  /// alone then determine the files of the scan.
  bool opens_first(const std::vector<std::filesystem::path>& inputs,
                   const farm::Parameters& parameters) const override;
  Result<std::unique_ptr<farm::OpenedScan>> open(const nlohmann::json& given,
                                                 const std::vector<std::filesystem::path>& inputs,
                                                 const std::string& series,
                                                 int threads) const override;

 private:
  std::string digest_;
};

/// The names of the options that a collection may give as parameters, without the leading --.
std::vector<std::string> collection_options();

}  // namespace trocar::pipeline
