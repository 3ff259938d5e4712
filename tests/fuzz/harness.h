// SPDX-License-Identifier: GPL-3.0-or-later
// Shared by the fuzz harnesses. Each defines LLVMFuzzerTestOneInput() for libFuzzer or replay.cpp.
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

/// Reports a finding: prints it and aborts.
[[noreturn]] void fail(const std::string& what);

/// Reads an input byte by byte; after its end it gives zeros.
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
  /// Any bit pattern of a double.
  double real() {
    std::uint64_t out = 0;
    for (int i = 0; i < 8; ++i)
      out |= std::uint64_t{next()} << (8 * i);
    return std::bit_cast<double>(out);
  }

 private:
  const std::uint8_t *at_, *end_;
};

/// Writes the input to a file of this process (in /dev/shm if possible), overwriting the last one.
std::filesystem::path as_file(const std::uint8_t* data, std::size_t size, const char* ending);

/// Aborts unless the error is a refusal with a message of one line and at least 10 characters.
void expect_refusal(const Error& error);

/// Reads every slice (up to 64) and aborts on results that a reader must never give: invalid sizes
/// or planes, values that are not finite.
void read_all(const Result<std::unique_ptr<pipeline::SliceStack>>& stack);

}  // namespace trocar::fuzz
