// SPDX-License-Identifier: Apache-2.0
// The contract of formats/session/telemetry.h.
#include "formats/session/telemetry.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <thread>

#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

using std::chrono::steady_clock;

using test::TemporaryFolder;

TelemetrySizes some_sizes() {
  TelemetrySizes sizes;
  sizes.about = R"({"schema": "trocar.live/1"})";
  sizes.columns = 300;
  sizes.sheets = {{100, 180, true}, {10, 8, false}};
  sizes.has_shape = true;
  sizes.has_hand = true;
  return sizes;
}

std::unique_ptr<TelemetryWriter> make_writer(const TelemetrySizes& sizes = some_sizes()) {
  auto writer = TelemetryWriter::make(sizes);
  EXPECT_TRUE(writer) << writer.error().message;
  return std::move(*writer);
}

std::unique_ptr<TelemetryReader> open_reader(const TelemetryWriter& writer) {
  auto reader = TelemetryReader::open("/proc/self/fd/" + std::to_string(writer.fd()));
  EXPECT_TRUE(reader) << reader.error().message;
  return std::move(*reader);
}

/// All numbers of a value follow from its first.
std::vector<double> snapshot_of(double k, std::size_t columns) {
  std::vector<double> values(columns);
  for (std::size_t i = 0; i < columns; ++i)
    values[i] = k + 1e-3 * static_cast<double>(i);
  return values;
}

TelemetryEvent event_of(std::uint64_t k) {
  TelemetryEvent event;
  event.kind = TelemetryEventKind::kPuncture;
  event.t_s = static_cast<double>(k);
  event.sheet = static_cast<std::int32_t>(k % 64);
  event.cut = static_cast<std::uint32_t>(k);
  event.trial_force_N = -static_cast<double>(k);
  event.hand_N = 2 * static_cast<double>(k);
  return event;
}
bool is_whole(const TelemetryEvent& event) {
  const auto k = static_cast<double>(event.number);
  return event.t_s == k && event.cut == static_cast<std::uint32_t>(event.number) &&
         event.trial_force_N == -k && event.hand_N == 2 * k &&
         event.sheet == static_cast<int>(event.number % 64);
}

TelemetrySheet sheet_of(std::uint32_t cuts) {
  TelemetrySheet sheet;
  sheet.cuts = cuts;
  const std::uint32_t vertices = 90 + cuts % 20;
  for (std::uint32_t i = 0; i < vertices; ++i) {
    sheet.xy_m.push_back(static_cast<float>(cuts + i));
    sheet.xy_m.push_back(-static_cast<float>(cuts));
    sheet.hu.push_back(static_cast<float>(i) * 10);
  }
  for (std::uint32_t i = 0; i < 150 + cuts % 30; ++i)
    sheet.triangles.insert(sheet.triangles.end(), {(cuts + i) % vertices, i % vertices, 0});
  return sheet;
}
bool is_whole(const TelemetrySheet& sheet) {
  const TelemetrySheet wanted = sheet_of(sheet.cuts);
  return sheet.is_shown && sheet.xy_m == wanted.xy_m && sheet.hu == wanted.hu &&
         sheet.triangles == wanted.triangles;
}

/// The first inconsistency that a reader detected; empty if there is none.
std::string watch(TelemetryReader& reader, const std::function<bool()>& goes_on) {
  std::vector<double> values;
  TelemetryEvent event;
  TelemetrySheet sheet;
  double last = 0;
  std::uint64_t lost = 0, next = 1, reads = 0;
  std::uint32_t last_cuts = 0;
  const auto take_events = [&]() -> std::string {
    for (int i = 0; i < 50; ++i) {
      const TelemetryReader::Next what = reader.next_event(event, lost);
      if (what == TelemetryReader::Next::kNone) break;
      if (what == TelemetryReader::Next::kLost) {
        if (event.number != next + lost || lost == 0) return "a wrong number of lost events";
        next = event.number;
        continue;
      }
      if (event.number != next) return "an event was lost without a word";
      if (!is_whole(event)) return "a torn event";
      ++next;
    }
    return {};
  };
  while (goes_on()) {
    if (reader.snapshot(values)) {
      ++reads;
      if (values != snapshot_of(values[0], values.size())) return "a torn snapshot";
      if (values[0] < last) return "an older snapshot after a newer one";
      last = values[0];
    }
    if (std::string wrong = take_events(); !wrong.empty()) return wrong;
    if (reader.sheet(0, sheet)) {
      if (!is_whole(sheet)) return "a torn sheet";
      if (sheet.cuts < last_cuts) return "an older sheet after a newer one";
      last_cuts = sheet.cuts;
    }
  }
  return reads > 0 ? "" : "no snapshot at all";
}

/// Writes for a time as fast as it can.
void write_for(TelemetryWriter& writer, std::chrono::milliseconds time) {
  const auto end = steady_clock::now() + time;
  std::thread other([&] {  // sheets are another thread's
    for (std::uint32_t cuts = 0; steady_clock::now() < end; ++cuts)
      writer.sheet(0, sheet_of(cuts));
  });
  for (std::uint64_t k = 1; steady_clock::now() < end; ++k) {
    writer.snapshot(snapshot_of(static_cast<double>(k), 300));
    TelemetryEvent event = event_of(k);
    writer.event(event);
  }
  other.join();
}

TEST(TelemetryMemory, ThreadsReadNothingTornAndNothingBackwards) {
  const auto writer = make_writer();
  std::atomic<bool> done{false};
  std::vector<std::thread> threads;
  std::array<std::string, 4> wrong;
  threads.reserve(wrong.size());
  for (std::string& text : wrong) {
    threads.emplace_back([&text, &writer, &done] {
      const auto reader = open_reader(*writer);
      text = watch(*reader, [&] { return !done.load(); });
    });
  }
  write_for(*writer, std::chrono::milliseconds(1500));
  done.store(true);
  for (std::thread& thread : threads)
    thread.join();
  for (const std::string& text : wrong)
    EXPECT_EQ(text, "");
}

TEST(TelemetryMemory, EventsThatAreOverwrittenMeanwhileAreNotTorn) {
  const auto writer = make_writer();
  std::atomic<bool> done{false};
  std::uint64_t torn = 0, whole = 0;
  std::thread thread([&] {
    const auto reader = open_reader(*writer);
    TelemetryEvent event;
    std::uint64_t lost = 0;
    while (!done.load()) {
      // The oldest that is kept: the writer is about to take its slot.
      const std::uint64_t last = reader->last_event();
      if (last < kTelemetryEvents) continue;
      reader->go_to_event(last - kTelemetryEvents);
      for (int i = 0; i < 4; ++i) {
        if (reader->next_event(event, lost) == TelemetryReader::Next::kEvent)
          ++(is_whole(event) ? whole : torn);
      }
    }
  });
  const auto end = steady_clock::now() + std::chrono::milliseconds(1500);
  for (std::uint64_t k = 1; k % 1024 != 0 || steady_clock::now() < end; ++k) {
    TelemetryEvent event = event_of(k);
    writer->event(event);
  }
  done.store(true);
  thread.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_GT(whole, 0U);
}

TEST(TelemetryMemory, ALappedReaderIsToldHowManyEventsItLost) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  TelemetryEvent event;
  std::uint64_t lost = 0;
  EXPECT_EQ(reader->next_event(event, lost), TelemetryReader::Next::kNone);
  constexpr std::uint64_t kWritten = 10'000;
  for (std::uint64_t k = 1; k <= kWritten; ++k) {
    TelemetryEvent next = event_of(k);
    writer->event(next);
    EXPECT_EQ(next.number, k);
  }
  ASSERT_EQ(reader->next_event(event, lost), TelemetryReader::Next::kLost);
  // The oldest slot is the one that the next event takes, so it is not counted on.
  EXPECT_EQ(lost, kWritten - (kTelemetryEvents - 1));
  EXPECT_EQ(event.number, lost + 1);
  std::uint64_t seen = 0;
  while (reader->next_event(event, lost) == TelemetryReader::Next::kEvent) {
    EXPECT_TRUE(is_whole(event));
    ++seen;
    EXPECT_EQ(event.number, kWritten - (kTelemetryEvents - 1) + seen);
  }
  EXPECT_EQ(seen, kTelemetryEvents - 1);
  reader->go_to_event(kWritten - 3);
  ASSERT_EQ(reader->next_event(event, lost), TelemetryReader::Next::kEvent);
  EXPECT_EQ(event.number, kWritten - 2);
}

TEST(TelemetryMemory, AnEventKeepsAllItsFields) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  TelemetryEvent event;
  event.kind = TelemetryEventKind::kFault;
  event.t_s = 0.125;
  event.slice = -7;
  event.found = {Fault::kWorkspace, FaultQuantity::kPlatePosition, 2, 0.25,
                 std::numeric_limits<double>::infinity()};
  event.retract_distance_m = 3e-3;
  writer->event(event);
  TelemetryEvent end;
  end.kind = TelemetryEventKind::kEnded;
  end.end = TelemetryEnd::kFault;
  writer->event(end);
  TelemetryEvent found;
  std::uint64_t lost = 0;
  ASSERT_EQ(reader->next_event(found, lost), TelemetryReader::Next::kEvent);
  EXPECT_EQ(found.kind, TelemetryEventKind::kFault);
  EXPECT_EQ(found.slice, -7);
  EXPECT_EQ(found.found.fault, Fault::kWorkspace);
  EXPECT_EQ(measured(found.found), "plate z 250 mm, at least inf mm");
  EXPECT_EQ(found.retract_distance_m, 3e-3);
  ASSERT_EQ(reader->next_event(found, lost), TelemetryReader::Next::kEvent);
  EXPECT_EQ(found.end, TelemetryEnd::kFault);
}

TEST(TelemetryMemory, AMeshThatDoesNotFitIsNotShown) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  EXPECT_EQ(reader->sheet_version(0), 0U);
  TelemetrySheet sheet;
  EXPECT_FALSE(reader->sheet(0, sheet));
  writer->sheet(0, sheet_of(3));
  ASSERT_TRUE(reader->sheet(0, sheet));
  EXPECT_TRUE(is_whole(sheet));
  EXPECT_EQ(sheet.cuts, 3U);
  const std::uint64_t version = reader->sheet_version(0);
  TelemetrySheet large = sheet_of(4);
  large.triangles.resize(3 * 20'000);
  writer->sheet(0, large);
  EXPECT_NE(reader->sheet_version(0), version);
  ASSERT_TRUE(reader->sheet(0, sheet));
  EXPECT_FALSE(sheet.is_shown);
  EXPECT_EQ(sheet.cuts, 4U);
  EXPECT_TRUE(sheet.xy_m.empty());
  EXPECT_TRUE(sheet.triangles.empty());
  EXPECT_FALSE(reader->sheet(2, sheet));

  TelemetryShape shape;
  EXPECT_FALSE(reader->shape(shape));
  shape.sheet = 1;
  shape.z_m = -0.5;
  shape.xyw = {0, 0, 1, 1, 0, 0.5F, 0, 1, 0.25F};
  shape.triangles = {0, 1, 2};
  writer->shape(shape);
  TelemetryShape found;
  ASSERT_TRUE(reader->shape(found));
  EXPECT_EQ(found.xyw, shape.xyw);
  EXPECT_EQ(found.triangles, shape.triangles);
  EXPECT_EQ(found.z_m, -0.5);
  EXPECT_TRUE(found.is_shown);
}

TEST(TelemetryMemory, CommandsArrive) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  for (std::size_t i = 0; i < kTelemetryCommands; ++i) {
    const auto command = static_cast<TelemetryCommand>(i);
    EXPECT_EQ(writer->commands(command), 0U);
    reader->command(command);
    reader->command(command);
    EXPECT_EQ(writer->commands(command), 2U) << to_string(command);
  }
}

TEST(TelemetryMemory, ScreeningIsOddWhileItIsHeldAndChangesEachTime) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  EXPECT_EQ(writer->screening(), 0U);
  std::uint64_t before = 0;
  for (const bool is_held : {true, true, false, false, true, false}) {
    reader->screen(is_held);
    EXPECT_EQ(writer->screening() % 2, is_held ? 1U : 0U);
    EXPECT_GT(writer->screening(), before);
    before = writer->screening();
  }
}

/// A hand whose numbers follow from its count.
TelemetryHand hand_of(std::uint64_t count) {
  TelemetryHand hand;
  hand.count = count;
  hand.is_held = count % 2 != 0;
  for (std::size_t i = 0; i < hand.target.size(); ++i)
    hand.target[i] = static_cast<double>(count) + static_cast<double>(i);
  return hand;
}
bool is_whole(const TelemetryHand& hand) {
  return hand.is_held == hand_of(hand.count).is_held && hand.target == hand_of(hand.count).target;
}

TEST(TelemetryMemory, AHandArrivesWholeOrNotAtAll) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  ASSERT_TRUE(reader->has_hand());
  TelemetryHand hand = hand_of(7);
  EXPECT_FALSE(writer->hand(hand)) << "nothing was written yet";
  EXPECT_EQ(hand.count, 7U);
  std::atomic<bool> done{false};
  std::thread console([&] {
    for (std::uint64_t count = 1; !done.load(); ++count)
      reader->hand(hand_of(count));
  });
  std::uint64_t last = 0, reads = 0;
  const auto end = steady_clock::now() + std::chrono::milliseconds(1000);
  while (steady_clock::now() < end) {
    if (!writer->hand(hand)) continue;
    ++reads;
    ASSERT_TRUE(is_whole(hand)) << hand.count;
    ASSERT_GE(hand.count, last);
    last = hand.count;
  }
  done.store(true);
  console.join();
  EXPECT_GT(reads, 0U);
}

TEST(TelemetryMemory, OnlyASessionWithALiveHandHasOne) {
  TelemetrySizes sizes = some_sizes();
  sizes.has_hand = false;
  const auto writer = make_writer(sizes);
  EXPECT_FALSE(open_reader(*writer)->has_hand());
  TelemetryHand hand;
  EXPECT_FALSE(writer->hand(hand));
}

TEST(TelemetryMemory, ATornOrHostileHandChangesNothingAndTheNextOneHeals) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  auto* const words = static_cast<std::atomic<std::uint64_t>*>(
      ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, writer->fd(), 0));
  ASSERT_NE(words, MAP_FAILED);
  const std::uint64_t hand_at = words[14].load();
  EXPECT_EQ(words[15].load(), 9U);
  EXPECT_EQ(hand_at, words[13].load() + 64);
  auto* const page = static_cast<std::atomic<std::uint64_t>*>(
      ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, writer->fd(),
             static_cast<off_t>(words[13].load())));
  ASSERT_NE(page, MAP_FAILED);
  auto* const hand_words = page + 8;
  reader->hand(hand_of(5));
  TelemetryHand hand;
  ASSERT_TRUE(writer->hand(hand));
  // A console that was killed in a write leaves an odd sequence; the next one goes on.
  hand_words[0].fetch_add(1);
  hand_words[1].store(99);
  EXPECT_FALSE(writer->hand(hand));
  EXPECT_EQ(hand.count, 5U);
  reader->hand(hand_of(6));
  ASSERT_TRUE(writer->hand(hand));
  EXPECT_EQ(hand.count, 6U);
  // Any words are numbers; who uses them checks these.
  std::mt19937_64 random(20261125);
  for (int round = 0; round < 10'000; ++round) {
    for (std::size_t i = 0; i < 9; ++i)
      hand_words[i].store(random());
    writer->hand(hand);
  }
  ::munmap(words, 4096);
  ::munmap(page, 4096);
}

/// A process with a writer that is linked and then does this. Returns once the link is there.
pid_t fork_writer(const std::filesystem::path& file,
                  const std::function<void(TelemetryWriter&)>& goes_on) {
  std::array<int, 2> pipe{};
  EXPECT_EQ(::pipe(pipe.data()), 0);
  const pid_t child = ::fork();
  char ready = 0;
  if (child == 0) {
    const auto writer = make_writer();
    ready = writer->link(file) ? 1 : 0;
    if (::write(pipe[1], &ready, 1) == 1) goes_on(*writer);
    ::_exit(0);
  }
  EXPECT_EQ(::read(pipe[0], &ready, 1), 1);
  EXPECT_EQ(ready, 1);
  ::close(pipe[0]);
  ::close(pipe[1]);
  return child;
}

TEST(TelemetryMemory, ALinkOfADeadProcessIsReplacedAndOfALivingOneRefused) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / "live";
  EXPECT_FALSE(TelemetryReader::open(file));
  const pid_t child = fork_writer(file, [](TelemetryWriter&) { ::pause(); });
  auto reader = TelemetryReader::open(file);
  ASSERT_TRUE(reader);
  EXPECT_TRUE((*reader)->writer_is_alive());

  auto second = make_writer();
  const Result<void> refused_link = second->link(file);
  ASSERT_FALSE(refused_link);
  EXPECT_NE(refused_link.error().message.find("a running session"), std::string::npos)
      << refused_link.error().message;

  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  EXPECT_FALSE((*reader)->writer_is_alive());
  const auto dead = TelemetryReader::open(file);
  ASSERT_FALSE(dead);
  EXPECT_NE(dead.error().message.find("has ended"), std::string::npos) << dead.error().message;
  EXPECT_TRUE(second->link(file));
  EXPECT_TRUE(TelemetryReader::open(file));
  second.reset();
  EXPECT_FALSE(std::filesystem::is_symlink(std::filesystem::symlink_status(file)));

  // A file that is not a session's link is left unchanged.
  std::ofstream(folder / "data") << "data";
  EXPECT_FALSE(make_writer()->link(folder / "data"));
  std::filesystem::create_symlink(folder / "data", folder / "to_data");
  EXPECT_FALSE(make_writer()->link(folder / "to_data"));
  std::filesystem::create_symlink(folder / "nowhere", folder / "dangling");
  EXPECT_FALSE(make_writer()->link(folder / "dangling"));
}

TEST(TelemetryMemory, AWriterKilledInAWriteLeavesReadersThatGoOn) {
  const TemporaryFolder folder;
  for (int round = 0; round < 20; ++round) {
    const pid_t child = fork_writer(folder / "live", [](TelemetryWriter& writer) {
      write_for(writer, std::chrono::seconds(60));
    });
    auto reader = TelemetryReader::open(folder / "live");
    ASSERT_TRUE(reader);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
    // Ends, and tears nothing; the writer may have died in the middle of any part.
    std::vector<double> values;
    if ((*reader)->snapshot(values)) {
      EXPECT_EQ(values, snapshot_of(values[0], values.size()));
    }
    TelemetrySheet sheet;
    if ((*reader)->sheet(0, sheet)) {
      EXPECT_TRUE(is_whole(sheet));
    }
    EXPECT_FALSE((*reader)->writer_is_alive());
    // The next round's writer takes the link over.
  }
}

TEST(TelemetryMemory, AnUnfinishedWriteIsGivenUpAndTheNextWriteHeals) {
  const auto writer = make_writer();
  const auto reader = open_reader(*writer);
  writer->snapshot(snapshot_of(1, 300));
  // Simulate an interrupted write: the sequence is odd.
  auto* memory = static_cast<std::atomic<std::uint64_t>*>(
      ::mmap(nullptr, 8192, PROT_READ | PROT_WRITE, MAP_SHARED, writer->fd(), 0));
  ASSERT_NE(memory, MAP_FAILED);
  auto& sequence = memory[memory[5].load() / 8];
  ASSERT_EQ(sequence.load(), 2U);
  sequence.store(3);
  std::vector<double> values;
  EXPECT_FALSE(reader->snapshot(values));
  writer->snapshot(snapshot_of(2, 300));
  ASSERT_TRUE(reader->snapshot(values));
  EXPECT_EQ(values, snapshot_of(2, 300));
  ::munmap(memory, 8192);
}

/// A copy of a writer's memory that can be damaged.
class Copy {
 public:
  explicit Copy(int seals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL, std::int64_t more = 0) {
    const auto writer = make_writer();
    writer->snapshot(snapshot_of(1, 300));
    writer->sheet(0, sheet_of(0));
    for (std::uint64_t k = 1; k < 4; ++k) {
      TelemetryEvent event = event_of(k);
      writer->event(event);
    }
    const off_t size = ::lseek(writer->fd(), 0, SEEK_END);
    std::vector<char> bytes(static_cast<std::size_t>(size));
    EXPECT_EQ(::pread(writer->fd(), bytes.data(), bytes.size(), 0), size);
    fd_ = ::memfd_create("copy", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    size_ = static_cast<std::size_t>(size + more);
    bytes.resize(size_);
    EXPECT_EQ(::pwrite(fd_, bytes.data(), size_, 0), static_cast<ssize_t>(size_));
    if (seals != 0) {
      EXPECT_EQ(::fcntl(fd_, F_ADD_SEALS, seals), 0);
    }
  }
  ~Copy() { ::close(fd_); }
  Copy(const Copy&) = delete;
  Copy& operator=(const Copy&) = delete;

  std::uint64_t word(std::size_t i) const {
    std::uint64_t value = 0;
    EXPECT_EQ(::pread(fd_, &value, 8, static_cast<off_t>(8 * i)), 8);
    return value;
  }
  void set(std::size_t i, std::uint64_t value) const {
    EXPECT_EQ(::pwrite(fd_, &value, 8, static_cast<off_t>(8 * i)), 8);
  }
  Result<std::unique_ptr<TelemetryReader>> open() const {
    return TelemetryReader::open("/proc/self/fd/" + std::to_string(fd_));
  }
  std::size_t words() const { return size_ / 8; }

 private:
  int fd_ = -1;
  std::size_t size_ = 0;
};

TEST(TelemetryMemory, WhatIsNotAMemoryIsRefused) {
  EXPECT_TRUE(Copy().open());
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << std::string(100'000, 'x');
  EXPECT_FALSE(TelemetryReader::open(folder / "file"));
  EXPECT_FALSE(TelemetryReader::open(folder.path()));
  EXPECT_FALSE(TelemetryReader::open("/dev/null"));
  ASSERT_EQ(::mkfifo((folder / "fifo").c_str(), 0600), 0);
  EXPECT_FALSE(TelemetryReader::open(folder / "fifo"));
  for (const int seals : {0, F_SEAL_SHRINK, F_SEAL_GROW, F_SEAL_SHRINK | F_SEAL_GROW})
    EXPECT_FALSE(Copy(seals).open()) << seals;
  const auto other = Copy(F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL, 4096).open();
  ASSERT_FALSE(other);
  EXPECT_NE(other.error().message.find("its size differs"), std::string::npos);
  EXPECT_FALSE(Copy(F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL, -4096).open());
  EXPECT_FALSE(Copy(F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL, 8).open());
}

TEST(TelemetryMemory, EveryDamagedWordOfTheHeaderIsRefused) {
  const std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
  for (std::size_t i = 0; i < 16; ++i) {
    for (const std::uint64_t value :
         {most, most - 7, most / 2, std::uint64_t{1} << 40U, std::uint64_t{3}}) {
      const Copy copy;
      copy.set(i, value);
      const auto reader = copy.open();
      // Fewer columns, sheets or bytes, or a smaller shape, are another memory that is possible.
      const bool is_less = value == 3 && (i == 4 || i == 6 || i == 8);
      EXPECT_EQ(static_cast<bool>(reader), is_less) << "word " << i << " = " << value;
    }
  }
  // Places of the sheets.
  const std::size_t directory = Copy().word(9) / 8;
  for (std::size_t i = 0; i < 4; ++i) {
    for (const std::uint64_t value : {most, most / 8, most / 4 + 2, std::uint64_t{1} << 50U}) {
      const Copy copy;
      copy.set(directory + i, value);
      EXPECT_FALSE(copy.open()) << "directory " << i << " = " << value;
    }
  }
}

TEST(TelemetryMemory, DamagedPartsGiveNoValues) {
  const std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
  const std::size_t sheet_at = Copy().word(Copy().word(9) / 8) / 8;
  TelemetrySheet sheet;
  for (const std::size_t head : {3, 4}) {  // vertices, triangles
    for (const std::uint64_t value :
         {most, most / 3 + 1, std::uint64_t{1} << 62U, std::uint64_t{1} << 20U}) {
      const Copy copy;
      copy.set(sheet_at + head, value);
      const auto reader = copy.open();
      ASSERT_TRUE(reader);
      EXPECT_FALSE((*reader)->sheet(0, sheet)) << head << " = " << value;
    }
  }
  {  // an index of a triangle
    const Copy copy;
    copy.set(sheet_at + 8 + (3 * 90 + 1) / 2, most);
    const auto reader = copy.open();
    ASSERT_TRUE(reader);
    EXPECT_FALSE((*reader)->sheet(0, sheet));
  }
  // Events: kind, fault, quantity, index.
  const std::size_t events_at = Copy().word(11) / 8;
  for (const std::size_t field : {1, 10, 11, 12}) {
    for (const std::uint64_t value : {most - 1, std::uint64_t{200}, std::uint64_t{1} << 32U}) {
      const Copy copy;
      copy.set(events_at + 8 + 16 + field, value);
      const auto reader = copy.open();
      ASSERT_TRUE(reader);
      TelemetryEvent event;
      std::uint64_t lost = 0;
      EXPECT_EQ((*reader)->next_event(event, lost), TelemetryReader::Next::kEvent);
      EXPECT_EQ((*reader)->next_event(event, lost), TelemetryReader::Next::kLost) << field;
      EXPECT_EQ(lost, 1U);
      EXPECT_EQ((*reader)->next_event(event, lost), TelemetryReader::Next::kEvent);
      EXPECT_EQ(event.number, 3U);
    }
  }
  {  // a last event that cannot be
    const Copy copy;
    copy.set(events_at, most);
    const auto reader = copy.open();
    ASSERT_TRUE(reader);
    TelemetryEvent event;
    std::uint64_t lost = 0;
    EXPECT_EQ((*reader)->next_event(event, lost), TelemetryReader::Next::kLost);
    for (int i = 0; i < 10; ++i)
      (*reader)->next_event(event, lost);
  }
}

TEST(TelemetryMemory, RandomDamageNeverReadsOutside) {
  std::mt19937_64 random(20261122);
  TelemetryEvent event;
  TelemetrySheet sheet;
  TelemetryShape shape;
  std::vector<double> values;
  for (int round = 0; round < 200; ++round) {
    const Copy copy;
    const std::size_t until = round % 2 == 0 ? 64 : copy.words();
    for (int i = 0; i < 4; ++i)
      copy.set(random() % until, round % 3 == 0 ? random() % 100'000 : random());
    const auto reader = copy.open();
    if (!reader) continue;
    (*reader)->snapshot(values);
    for (std::size_t i = 0; i < (*reader)->sheets(); ++i)
      (*reader)->sheet(i, sheet);
    (*reader)->shape(shape);
    std::uint64_t lost = 0;
    for (int i = 0; i < 10; ++i) {
      if ((*reader)->next_event(event, lost) == TelemetryReader::Next::kEvent) {
        describe(event.found, event.t_s);
        to_string(event.kind);
      }
    }
  }
}

}  // namespace
}  // namespace trocar
