// SPDX-License-Identifier: GPL-3.0-or-later
// What the fuzz harnesses share: each defines LLVMFuzzerTestOneInput(), for libFuzzer or
// replay.cpp.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace trocar::fuzz {

/// Says what went wrong and aborts: a finding.
[[noreturn]] void fail(const std::string& what);

/// Takes an input apart, byte by byte; at its end come zeros.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : at_(data), end_(data + size) {}
  bool empty() const { return at_ == end_; }
  std::size_t left() const { return static_cast<std::size_t>(end_ - at_); }
  std::uint8_t next() { return empty() ? std::uint8_t{0} : *at_++; }
  int small() { return static_cast<std::int8_t>(next()); }  ///< -128 .. 127
  /// 0 .. n - 1.
  int below(int n) { return next() % n; }
  std::int32_t word() {
    std::uint32_t out = 0;
    for (int i = 0; i < 4; ++i)
      out |= static_cast<std::uint32_t>(next()) << (8 * i);
    return static_cast<std::int32_t>(out);
  }
  /// Any double there is.
  double real() {
    std::uint64_t out = 0;
    for (int i = 0; i < 8; ++i)
      out |= std::uint64_t{next()} << (8 * i);
    return std::bit_cast<double>(out);
  }

 private:
  const std::uint8_t *at_, *end_;
};

/// The input as a file of this process (in memory where there is /dev/shm), overwritten each time.
std::filesystem::path as_file(const std::uint8_t* data, std::size_t size, const char* ending);

/// Aborts unless the error is a refusal of one line that says something.
void expect_refusal(const Error& error);

/// Opens nothing more than it was given, reads every slice (up to 64), and aborts on what a reader
/// must never give: a plane or size that is no plane or size, values that are not finite.
void read_all(const Result<std::unique_ptr<pipeline::SliceStack>>& stack);

}  // namespace trocar::fuzz
