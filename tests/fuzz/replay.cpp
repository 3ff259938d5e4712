// SPDX-License-Identifier: GPL-3.0-or-later
// Runs a harness without libFuzzer: replays a corpus, then mutants of it.
//   fuzz_X_replay FOLDER_OR_FILE... [--mutants N] [--seed S]
// The same seed gives the same mutants everywhere. An input that crashes, aborts or runs longer
// than 10 s is written to ./crash-PID.bin, and the process ends by the signal.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/harness.h"

namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr unsigned kMaxSeconds = 10;
constexpr std::size_t kMaxBytes = 1 << 20;

Bytes input;  // the current input, for the signal handler
char crash_name[64];

void write_input(int signal) {
  const int descriptor = ::open(crash_name, O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (descriptor >= 0 && ::write(descriptor, input.data(), input.size()) > 0) ::close(descriptor);
  std::signal(signal, SIG_DFL);
  ::raise(signal);
}

// Uses the engine directly: distributions differ between standard libraries.
struct Random {
  std::mt19937_64 engine;
  std::size_t below(std::size_t n) { return n == 0 ? 0 : static_cast<std::size_t>(engine() % n); }
};

void overwrite(Bytes& b, std::size_t at, std::uint64_t value, std::size_t bytes, bool big) {
  for (std::size_t i = 0; i < bytes && at + i < b.size(); ++i) {
    b[at + i] = static_cast<std::uint8_t>(value >> (8 * (big ? bytes - 1 - i : i)));
  }
}

void mutate_once(Bytes& b, const std::vector<Bytes>& seeds, Random& random) {
  static constexpr std::uint64_t kInteresting[] = {0,
                                                   1,
                                                   2,
                                                   3,
                                                   7,
                                                   8,
                                                   15,
                                                   16,
                                                   17,
                                                   31,
                                                   32,
                                                   64,
                                                   127,
                                                   128,
                                                   255,
                                                   256,
                                                   511,
                                                   512,
                                                   1000,
                                                   0x7fff,
                                                   0x8000,
                                                   0xffff,
                                                   0x10000,
                                                   0x7fffffff,
                                                   0x80000000,
                                                   0xfffffffe,
                                                   0xffffffff,
                                                   0x7fffffffffffffff,
                                                   0x8000000000000000,
                                                   0xffffffffffffffff};
  // Mostly in the header, where changes have more effect than in pixels.
  const std::size_t at = random.below(4) != 0 ? random.below(std::min<std::size_t>(b.size(), 1024))
                                              : random.below(b.size());
  const std::size_t length = 1 + random.below(random.below(2) == 0 ? 8 : 128);
  const auto begin = b.begin() + static_cast<std::ptrdiff_t>(at);
  const auto end = b.begin() + static_cast<std::ptrdiff_t>(std::min(b.size(), at + length));
  switch (random.below(10)) {
    case 0:
      b[at] ^= static_cast<std::uint8_t>(1u << random.below(8));
      break;
    case 1:
      b[at] = static_cast<std::uint8_t>(random.below(256));
      break;
    case 2:
      overwrite(b, at, kInteresting[random.below(std::size(kInteresting))],
                std::size_t{1} << random.below(4), random.below(2) == 0);
      break;
    case 3:
      b[at] = static_cast<std::uint8_t>(b[at] + 1 - 2 * random.below(2));
      break;
    case 4:
      b.resize(random.below(b.size()));
      break;
    case 5:
      b.erase(begin, end);
      break;
    case 6: {  // a piece repeated
      const Bytes piece(begin, end);
      b.insert(end, piece.begin(), piece.end());
      break;
    }
    case 7:
      std::fill(begin, end, static_cast<std::uint8_t>(random.below(2) * 255));
      break;
    case 8: {  // a piece of another seed at the same place
      const Bytes& other = seeds[random.below(seeds.size())];
      for (std::size_t i = at; i < std::min({b.size(), other.size(), at + length}); ++i)
        b[i] = other[i];
      break;
    }
    default: {  // one piece copied over another
      const std::size_t from = random.below(b.size());
      for (std::size_t i = 0; i < length && from + i < b.size() && at + i < b.size(); ++i)
        b[at + i] = b[from + i];
    }
  }
}

void run() {
  ::alarm(kMaxSeconds);
  LLVMFuzzerTestOneInput(input.data(), input.size());
  ::alarm(0);
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::filesystem::path> files;
  std::uint64_t mutants = 0, seed = 1;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--mutants") == 0 && i + 1 < argc) {
      mutants = std::strtoull(argv[++i], nullptr, 10);
    } else if (std::strcmp(argv[i], "--seed") == 0 && i + 1 < argc) {
      seed = std::strtoull(argv[++i], nullptr, 10);
    } else if (std::filesystem::is_directory(argv[i])) {
      for (const auto& entry : std::filesystem::directory_iterator(argv[i]))
        files.push_back(entry.path());
    } else {
      files.emplace_back(argv[i]);
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<Bytes> seeds;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    if (seeds.back().empty()) seeds.pop_back();
  }
  if (seeds.empty()) {
    std::fprintf(stderr, "no seeds\n");
    return 2;
  }
  std::snprintf(crash_name, sizeof crash_name, "crash-%d.bin", static_cast<int>(::getpid()));
  for (const int signal : {SIGALRM, SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL})
    std::signal(signal, write_input);

  for (const Bytes& whole : seeds) {
    input = whole;
    run();
  }
  Random random{std::mt19937_64(seed)};
  const auto start = std::chrono::steady_clock::now();
  double slowest = 0;
  for (std::uint64_t n = 0; n < mutants; ++n) {
    input = seeds[random.below(seeds.size())];
    for (std::size_t times = 1 + random.below(4); times > 0 && !input.empty(); --times)
      mutate_once(input, seeds, random);
    if (input.size() > kMaxBytes) input.resize(kMaxBytes);
    const auto before = std::chrono::steady_clock::now();
    run();
    slowest = std::max(
        slowest, std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count());
  }
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  std::printf("%zu seeds, %llu mutants, %.0f a second, slowest %.3f s, peak %ld MB\n", seeds.size(),
              static_cast<unsigned long long>(mutants),
              static_cast<double>(mutants) / std::max(seconds, 1e-9), slowest,
              used.ru_maxrss / 1024);
  return 0;
}
