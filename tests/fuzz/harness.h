// SPDX-License-Identifier: GPL-3.0-or-later
// What the fuzz harnesses share: each defines LLVMFuzzerTestOneInput(), for libFuzzer or
// replay.cpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "formats/result.h"
#include "pipeline/slice_stack.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace trocar::fuzz {

/// The input as a file of this process (in memory where there is /dev/shm), overwritten each time.
std::filesystem::path as_file(const std::uint8_t* data, std::size_t size, const char* ending);

/// Aborts unless the error is a refusal of one line that says something.
void expect_refusal(const Error& error);

/// Opens nothing more than it was given, reads every slice (up to 64), and aborts on what a reader
/// must never give: a plane or size that is no plane or size, values that are not finite.
void read_all(const Result<std::unique_ptr<pipeline::SliceStack>>& stack);

}  // namespace trocar::fuzz
