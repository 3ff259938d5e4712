// SPDX-License-Identifier: GPL-3.0-or-later
// The interface through which a batch opens and meshes scans; FarmScans (program/commands.h) implements it.
// The rest of this folder deals only with files, digests and processes.
#pragma once

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::farm {

/// A file or folder that a scan needs. `of` is its role: "input", or the name of the option that
/// gives the file, such as "hu" for --hu.
struct NamedFile {
  std::string of;
  std::filesystem::path path;
};

/// The parameters of a scan, checked and completed by the defaults.
struct Parameters {
  /// Every option that may change a byte of the outputs, with its given value or its default.
  nlohmann::json canonical;
  /// Files and folders that options name, in the order of the options' names.
  std::vector<NamedFile> files;
};

/// A scan's asset and report. The report has no times and no paths, and only the warnings of meshing,
/// so it depends only on the program, the canonical parameters and the bytes of the files.
struct ScanOutputs {
  std::vector<std::uint8_t> asset;
  std::string report;
};

class OpenedScan {
 public:
  OpenedScan() = default;
  OpenedScan(const OpenedScan&) = delete;
  OpenedScan& operator=(const OpenedScan&) = delete;
  virtual ~OpenedScan() = default;
  /// The files that the scan consists of, in the order in which the action (scan_files.h) lists the
  /// digests of each role.
  virtual std::vector<NamedFile> files() const = 0;
  /// The warnings of opening the scan: an array of objects with the texts `code`, `where` and
  /// `sentence`, and `shared` if a text without personal data must replace `sentence` in reports.
  virtual nlohmann::json warnings() const { return nlohmann::json::array(); }
  /// Meshes the scan.
  virtual Result<ScanOutputs> mesh() = 0;
};

class ScanProgram {
 public:
  ScanProgram() = default;
  ScanProgram(const ScanProgram&) = delete;
  ScanProgram& operator=(const ScanProgram&) = delete;
  virtual ~ScanProgram() = default;
  /// SHA-256 of the executable that meshes.
  virtual const std::string& digest() const = 0;
  /// Checks parameters as a collection gives them: names of options with their values. Errors:
  /// kUsage if the parameters are wrong; kRefused if a file that they name cannot be used.
  virtual Result<Parameters> parameters(const nlohmann::json& given) const = 0;
  /// Must the scan be opened before its key (scan_files.h) can be computed? True if it must be
  /// opened to find out which files of a folder belong to it, or whether the parameters suit it.
  virtual bool opens_first(const std::vector<std::filesystem::path>& inputs,
                           const Parameters& parameters) const = 0;
  /// Opens a scan. `given` are parameters as in parameters(). `inputs` are files, or one folder.
  /// Messages print these paths exactly as they are given here. `series` selects a DICOM series in
  /// the folder; empty: the default choice. Meshing uses `threads` threads. Errors: those of
  /// parameters() and of reading the scan; kUsage if the scan needs other parameters.
  virtual Result<std::unique_ptr<OpenedScan>> open(const nlohmann::json& given,
                                                   const std::vector<std::filesystem::path>& inputs,
                                                   const std::string& series,
                                                   int threads) const = 0;
};

// Reads a collection, the list of scans and parameters that `trocar-mesh batch`
// works through (formats/session/collection.schema.json).

struct CollectionScan {
  std::string name;
  std::vector<std::string> paths;  ///< a file or folder, or several files
  std::string glob;                ///< pattern for the scan's files; empty if `paths` is given
  /// UID, number or description of a series in a folder. If it is empty, trocar-mesh
  /// chooses the series.
  std::string series;
  /// The collection's defaults, overridden by the scan's own parameters. If the scan sets a
  /// parameter to false or null, the parameter is left out, even if the defaults have it.
  nlohmann::json parameters = nlohmann::json::object();
};

struct Collection {
  std::filesystem::path folder;  ///< folder from which all relative paths start
  std::vector<CollectionScan> scans;
};

/// Is the text a valid name of a scan? Files in the store are named after the scan, so a name must
/// be ASCII and have at most 120 characters. It begins with a letter, digit or underscore, followed
/// by letters, digits and . _ + -.
bool is_scan_name(std::string_view name);

/// Reads a collection from a text or a file. Collection::folder becomes the folder of `file`.
/// Errors: kUsage; the message names the file and the JSON member.
Result<Collection> parse_collection(std::string_view text, const std::filesystem::path& file);
Result<Collection> read_collection(const std::filesystem::path& file);

/// Makes a first collection for the scans in `folder`. `list` is the result of list_scans() for the
/// folder. The collection has every scan that `list` marks as usable, except localisers. The paths
/// of the scans are relative to `relative_to`, or absolute if it is empty. A scan keeps its name when
/// others, or more of its files, are added: the name of a series ends with a digest of its UID, and
/// scans whose names would be equal get a digest of their paths. A scan whose path a collection cannot state, because it has
/// control characters or is not UTF-8, is left out, and its path added to `left_out`.
nlohmann::json first_collection(const nlohmann::json& list, const std::filesystem::path& folder,
                                const std::filesystem::path& relative_to,
                                std::vector<std::string>* left_out = nullptr);

}  // namespace trocar::farm
