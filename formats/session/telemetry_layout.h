// SPDX-License-Identifier: Apache-2.0
// The layout of shared-memory telemetry (telemetry.md), used by writer and reader. The memory
// consists of 64-bit words. Internal to formats/session.
#pragma once
#include <fcntl.h>

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

namespace trocar::telemetry_layout {

using Word = std::atomic<std::uint64_t>;
static_assert(sizeof(Word) == 8 && Word::is_always_lock_free);
static_assert(std::endian::native == std::endian::little);

/// Word numbers in the header.
enum Header : std::size_t {
  kMagic,
  kVersion,
  kBytes,
  kAboutOffset,
  kAboutBytes,
  kSnapshotOffset,
  kColumns,
  kShapeOffset,
  kShapeWords,
  kDirectoryOffset,
  kSheets,
  kEventsOffset,
  kEventSlots,
  kCommandsOffset,
  kHandOffset,
  kHandSize,
  kHeaderWords = 16
};
inline constexpr std::uint64_t kMagicWord =
    std::bit_cast<std::uint64_t>(std::array<char, 8>{'T', 'R', 'C', 'R', 'L', 'I', 'V', 'E'});

/// Word numbers in the head of a mesh. The vertices and triangles of the mesh follow the head.
enum Mesh : std::size_t {
  kSequence,
  kMeshVersion,
  kFlags,
  kVertices,
  kTriangles,
  kMeshSheet,
  kMeshCuts,
  kHeight,
  kMeshHead
};
inline constexpr std::uint64_t kIsShown = 1, kHasHu = 2;  ///< bits of kFlags
/// Word numbers in the region of the live hand, which follows the commands in the same kPage bytes.
enum Hand : std::size_t {
  kHandSequence,
  kHandCount,
  kHandHeld,
  kHandPose,
  kHandWords = kHandPose + 6
};
inline constexpr std::size_t kHandInPage = 64;  ///< offset of the hand's region in the page, bytes

/// Number of words of an event, and of the head that precedes the first event.
inline constexpr std::size_t kEventWords = 16, kEventsHead = 8;

inline constexpr std::size_t kPage = 4096;
inline constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 34;
inline constexpr std::uint64_t kMaxAbout = std::uint64_t{1} << 24;
inline constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;

inline std::uint64_t word_of(double x) {
  return std::bit_cast<std::uint64_t>(x);
}
inline double number_in(std::uint64_t word) {
  return std::bit_cast<double>(word);
}
/// The integer is sign-extended to 64 bits.
inline std::uint64_t word_of(std::int32_t x) {
  return static_cast<std::uint64_t>(std::int64_t{x});
}
inline std::int32_t int_in(std::uint64_t word) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(word));
}

/// The argument of fcntl() for a write lock on all bytes of a file.
inline struct flock whole_file() {
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

/// The text of a symbolic link; empty if `file` is not a symbolic link.
std::string read_link(const std::filesystem::path& file);
/// Returns true if the text of a link has the form that TelemetryWriter::link() writes,
/// "/proc/PID/fd/N".
bool is_session_link(const std::string& target);

}  // namespace trocar::telemetry_layout
