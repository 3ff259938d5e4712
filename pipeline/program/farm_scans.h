// SPDX-License-Identifier: GPL-3.0-or-later
// The farm's interface to meshing (farm/scan_program.h). A scan's parameters are the options of
// trocar-mesh, read by the same parser.
// Tests: tests/pipeline/program/parameters_test.cpp
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "pipeline/farm/scan_program.h"

namespace trocar::pipeline {

class FarmScans : public farm::ScanProgram {
 public:
  /// Errors: kUsage if trocar-mesh does not have an option, or if a collection must not give it;
  /// those of the command line, with the same messages.
  Result<farm::Parameters> parameters(const nlohmann::json& given) const override;
  /// False if all inputs, and the CT of --hu if there is one, are NIfTI files.
  bool opens_first(const std::vector<std::filesystem::path>& inputs,
                   const farm::Parameters& parameters) const override;
  Result<std::unique_ptr<farm::OpenedScan>> open(const nlohmann::json& given,
                                                 const std::vector<std::filesystem::path>& inputs,
                                                 const std::string& series,
                                                 int threads) const override;
};

/// The options that a collection may give as parameters, without the leading --.
std::vector<std::string> collection_options();

}  // namespace trocar::pipeline
