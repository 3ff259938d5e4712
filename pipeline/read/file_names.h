// SPDX-License-Identifier: GPL-3.0-or-later
// The kind of a file according to its name, the order of files by name, and lists of their names.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

/// The text with the letters of ASCII in lower case.
std::string lower(std::string text);

/// Does the name end with one of the endings? The endings must be in lower case; the case of the
/// name does not matter.
bool has_ending(const std::filesystem::path& file, std::initializer_list<const char*> endings);

bool is_nifti(const std::filesystem::path& file);
bool is_nrrd(const std::filesystem::path& file);
/// Is it a file of volumes, NIfTI or NRRD?
bool is_volume(const std::filesystem::path& file);
/// The format of these files of volumes, for messages: "NIfTI", "NRRD" or "NIfTI or NRRD".
std::string format_of_volumes(const std::vector<std::filesystem::path>& files);
bool is_image(const std::filesystem::path& file);
bool is_dicomdir(const std::filesystem::path& file);
/// Is the file a DICOMDIR, or a file that an operating system leaves in folders (Thumbs.db,
/// desktop.ini)?
bool is_left_by_system(const std::filesystem::path& file);

/// Compares in natural order: slice_2 comes before slice_10, because runs of digits are compared as
/// numbers.
bool natural_less(const std::filesystem::path& one, const std::filesystem::path& other);

/// The error (kUsage) for an input that holds several files or folders, of which one must be given.
/// `what` names their kind. The message lists the first eight, and says how many there are.
Error choose_one(const std::string& where, const std::string& what,
                 const std::vector<std::filesystem::path>& these);

// Digests that identify an input without revealing its contents.

/// BLAKE2b-256 of a file's bytes, hexadecimal. Errors: kRefused if the file cannot be read.
Result<std::string> digest_file(const std::filesystem::path& file);

inline constexpr std::size_t kMinKeyBytes = 16, kMaxKeyBytes = 64;

/// The keyed digest of an input, hexadecimal: BLAKE2b-256 of the concatenated results of
/// digest_file() for its files. Only a holder of the key can compute it and so recognise the input.
/// Precondition: the key has kMinKeyBytes to kMaxKeyBytes bytes.
std::string digest_input(const std::vector<std::string>& file_digests,
                         const std::vector<std::uint8_t>& key);

}  // namespace trocar::pipeline
