// SPDX-License-Identifier: Apache-2.0
// The console without its server: tokens, names, files, the page's policy, processes, devices, the hand,
// the history of forces and the events of a recording.
#include <gtest/gtest.h>

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "formats/base/text.h"
#include "formats/session/recording.h"
#include "runtime/console/access.h"
#include "runtime/console/answers.h"
#include "runtime/console/device_test.h"
#include "runtime/console/files.h"
#include "runtime/console/process.h"
#include "runtime/console/session_files.h"
#include "runtime/console/session_telemetry.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;

// Tokens, names of the server, names of files, the list of a folder, the page's policy, processes.

void write(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

TEST(RequestTarget, PlusAndPercentStandForABlankInParameters) {
  const auto target = RequestTarget::parse("/a+b%20c?scene=my+own%20scene%2Bnew.json&asset=");
  ASSERT_TRUE(target);
  EXPECT_EQ(target->path, "/a+b c");
  EXPECT_EQ(target->parameter("scene"), "my own scene+new.json");
  EXPECT_EQ(target->parameter("asset"), "");
  for (const char* wrong : {"a", "/?x", "/?x=1&x=2", "/?x=%2", "/?x=%+1", "/?x=%-1", "/?x=%0x"})
    EXPECT_FALSE(RequestTarget::parse(wrong)) << wrong;
}

TEST(ConsoleTokens, RoleOfEachAndNoOther) {
  const Tokens tokens;
  EXPECT_EQ(tokens.of_operator().size(), 32U);
  EXPECT_NE(tokens.of_operator(), tokens.of_view());
  EXPECT_NE(tokens.of_operator(), Tokens().of_operator());
  EXPECT_EQ(tokens.role_of(tokens.of_operator()), Role::kOperator);
  EXPECT_EQ(tokens.role_of(tokens.of_view()), Role::kView);
  EXPECT_EQ(tokens.role_of_header("Bearer " + tokens.of_view()), Role::kView);
  for (const std::string& wrong :
       {std::string(), tokens.of_operator().substr(1), tokens.of_operator() + "0",
        std::string(32, '0'), "Basic " + tokens.of_operator()}) {
    EXPECT_EQ(tokens.role_of(wrong), Role::kNone) << wrong;
    EXPECT_EQ(tokens.role_of_header(wrong), Role::kNone) << wrong;
  }
}

TEST(ConsoleHosts, LoopbackAndTheListenAddress) {
  const HostNames hosts("192.168.1.5", 8000, ""), any("0.0.0.0", 8000, ""), v6("::1", 80, "");
  for (const char* good : {"127.0.0.1:8000", "localhost:8000", "[::1]:8000", "192.168.1.5:8000"})
    EXPECT_TRUE(hosts.is_host(good)) << good;
  for (const char* wrong :
       {"", "localhost", "127.0.0.1:8001", "evil.example:8000", "192.168.1.6:8000",
        "localhost.evil.example:8000", "127.0.0.1:80000", ":8000", "localhost:8000 "})
    EXPECT_FALSE(hosts.is_host(wrong)) << wrong;
  EXPECT_TRUE(any.is_host("10.0.0.7:8000"));
  EXPECT_FALSE(any.is_host("evil.example:8000"));
  EXPECT_TRUE(v6.is_host("[::1]"));
  EXPECT_TRUE(v6.is_host("localhost:80"));
}

TEST(ConsoleHosts, OriginIsTheSameServer) {
  const HostNames hosts("127.0.0.1", 8000, "");
  EXPECT_TRUE(hosts.is_origin("http://localhost:8000", "localhost:8000"));
  for (const char* wrong : {"", "null", "https://localhost:8000", "http://localhost:8001",
                            "http://localhost:8000/", "http://evil.example"})
    EXPECT_FALSE(hosts.is_origin(wrong, "localhost:8000")) << wrong;
}

TEST(ConsoleHosts, PublicUrlIsOneMore) {
  const auto url = public_url_of("https://Console.Example:8443/");
  ASSERT_TRUE(url) << url.error().message;
  EXPECT_EQ(*url, "https://console.example:8443");
  const HostNames hosts("127.0.0.1", 8000, *url);
  EXPECT_TRUE(hosts.is_host("console.example:8443"));
  EXPECT_TRUE(hosts.is_host("127.0.0.1:8000"));
  EXPECT_FALSE(hosts.is_host("console.example"));
  EXPECT_FALSE(hosts.is_host("console.example:8000"));
  EXPECT_TRUE(hosts.is_origin("https://console.example:8443", "console.example:8443"));
  for (const char* wrong : {"https://console.example", "https://console.example:8443/", "null"})
    EXPECT_FALSE(hosts.is_origin(wrong, "console.example:8443")) << wrong;
  EXPECT_FALSE(hosts.is_origin("https://console.example:8443", "127.0.0.1:8000"));
  EXPECT_EQ(*public_url_of("http://localhost:8080"), "http://localhost:8080");
  for (const char* wrong : {"", "localhost:8080", "ftp://a", "http://", "http://a/b", "http://a b",
                            "http://u@a", "http://a?b", "https://a#b"})
    EXPECT_FALSE(public_url_of(wrong)) << wrong;
}

TEST(ConsoleNames, StayInTheFolder) {
  for (const char* good : {"a", "a/b.json", "sessions/20261130T053438Z-one/session.csv", "a b"})
    EXPECT_TRUE(is_file_name(good)) << good;
  for (const std::string& wrong :
       {std::string(), std::string("/a"), std::string("a/"), std::string("a//b"),
        std::string("../a"), std::string("a/../b"), std::string(".a"), std::string("a/.b"),
        std::string("a\\b"), std::string("a\nb"), std::string("a\0b", 3), std::string(513, 'a'),
        std::string("a/b/c/d/e/f/g/h/i")})
    EXPECT_FALSE(is_file_name(wrong)) << wrong;
}

TEST(ConsoleFiles, ListHasTheRecordingOfASessionThatWasKilledButNotOfOneThatRuns) {
  const test::TemporaryFolder folder;
  const std::string rows = "t_s,x_m,y_m\n0,1,2\n0.5,1,2\n1,1,2\n";
  for (const char* name : {"sessions/a/session.csv.partial", "sessions/a/session.csv.partial.1"})
    write(folder.path() / name, rows + "1.5,1");
  write(folder.path() / "sessions/a/session.html", "of another session");
  write(folder.path() / "sessions/b/session.csv.partial", "t_s,x_m,y_m\n");
  write(folder.path() / "sessions/c/other.partial", rows);
  Result<Files> files = Files::of_folder(folder.path());
  ASSERT_TRUE(files);
  const auto list = [&] { return nlohmann::json::parse(files->list())["recordings"]; };
  const auto file = folder.path() / "sessions/a/session.csv.partial";
  const int fd = ::open(file.c_str(), O_WRONLY);
  ASSERT_EQ(::flock(fd, LOCK_EX), 0);
  ASSERT_EQ(list().size(), 2U);
  ::close(fd);
  const nlohmann::json found = list();
  ASSERT_EQ(found.size(), 3U) << "once its program has ended";
  EXPECT_EQ(found[0]["file"], "sessions/a/session.csv.partial");
  for (const nlohmann::json& killed : {found[0], found[1]}) {
    EXPECT_EQ(killed["partial"], true);
    EXPECT_EQ(killed["ticks"], 3) << "without the row that is cut";
    EXPECT_FALSE(killed.contains("report"));
  }
  EXPECT_TRUE(found[2].contains("error"));
}

TEST(ConsoleSessions, OnlyTheOwnerMayReadTheirFoldersWhoseNamesBeginWithTheTimeInUtc) {
  const test::TemporaryFolder folder;
  ::setenv("TZ", "Asia/Tokyo", 1);  // NOLINT(concurrency-mt-unsafe)
  const mode_t mask = ::umask(0);
  const auto before = utc_name(std::time(nullptr));
  const auto first = create_session_folder(folder / "new/sessions", "a/three slices.json"),
             second = create_session_folder(folder / "new/sessions", "a/three slices.json");
  const auto after = utc_name(std::time(nullptr));
  ::umask(mask);
  ::unsetenv("TZ");  // NOLINT(concurrency-mt-unsafe)
  ASSERT_TRUE(first && second);
  EXPECT_NE(*first, *second);
  const std::string name = first->filename().string();
  EXPECT_EQ(name.substr(before.size()), "-three_slices");
  EXPECT_TRUE(before <= name.substr(0, before.size()) && name.substr(0, before.size()) <= after);
  for (const auto& made : {*first, *second, folder / "new/sessions"})
    EXPECT_EQ(std::filesystem::status(made).permissions(), std::filesystem::perms::owner_all);
}

void write_glb(const std::filesystem::path& file, std::string text) {
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const auto word = [](std::size_t value) {
    std::string bytes(4, '\0');
    const auto number = static_cast<std::uint32_t>(value);
    std::memcpy(bytes.data(), &number, 4);
    return bytes;
  };
  write(file, "glTF" + word(2) + word(20 + text.size()) + word(text.size()) + "JSON" + text);
}

// Copies of deep JSON took all of the stack, and copies of a list for each node took hours.
TEST(ConsoleFiles, ListRefusesAssetsThatAreTooDeepOrTooLarge) {
  const test::TemporaryFolder folder;
  constexpr std::size_t kDepth = 500'000, kNodes = 50'000, kPrimitives = 50'000;
  write_glb(folder.path() / "deep.glb",
            R"({"extras":{"trocar":{"slices":1}},"accessors":[],"meshes":[],"nodes":)" +
                std::string(kDepth, '[') + std::string(kDepth, ']') + "}");
  std::string many =
      R"({"extras":{"trocar":{"slices":1}},"accessors":[],"meshes":[{"primitives":[{})";
  for (std::size_t i = 1; i < kPrimitives; ++i)
    many += ",{}";
  many += R"(]}],"nodes":[{"mesh":0})";
  for (std::size_t i = 1; i < kNodes; ++i)
    many += R"(,{"mesh":0})";
  write_glb(folder.path() / "many.glb", many + "]}");
  Result<Files> files = Files::of_folder(folder.path());
  ASSERT_TRUE(files);
  const nlohmann::json list = nlohmann::json::parse(files->list());
  ASSERT_EQ(list["assets"].size(), 2U);
  EXPECT_EQ(list["assets"][0]["error"], "deep.glb: its JSON is damaged");
  EXPECT_EQ(list["assets"][1]["error"], "many.glb: has more meshes than an asset may have");
}

TEST(ConsoleFiles, SessionsMayBeInAnotherFolder) {
  const test::TemporaryFolder outside, folder;
  const std::string recording = "t_s,x_m,y_m\n0,1,2\n0.5,1,2\n";
  write(folder.path() / "sessions/old/session.csv", recording);
  Result<Files> files = Files::of_folder(folder.path(), outside.path() / "state/sessions");
  ASSERT_TRUE(files);
  EXPECT_EQ(nlohmann::json::parse(files->list())["recordings"].size(), 1U);
  write(files->sessions() / "one/session.csv", recording);
  write(files->sessions() / "one/deep/er/session.csv", recording);
  std::filesystem::create_symlink(folder.path() / "sessions/old/session.csv",
                                  files->sessions() / "one/link.csv");
  const nlohmann::json list = nlohmann::json::parse(files->list());
  std::set<std::string> names;
  for (const auto& one : list["recordings"])
    names.insert(one["file"]);
  EXPECT_EQ(names, (std::set<std::string>{"sessions/old/session.csv", "sessions/one/session.csv"}));
  const auto found = files->find("sessions/one/session.csv");
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(*found, files->sessions() / "one/session.csv");
  for (const char* wrong :
       {"sessions/one/link.csv", "sessions/../sessions/one/session.csv", "sessions/"})
    EXPECT_FALSE(files->find(wrong)) << wrong;
}

TEST(ConsoleFiles, TimesOfARecordingMayBeAnything) {
  const test::TemporaryFolder folder;
  const std::vector<std::string> rows = {"nan,\n",
                                         "1e999,\n",
                                         "0,\n0,\n0,\n",
                                         "1,\n0,\n",
                                         "0,\n1e-300,\n1e300,\n",
                                         "\n\n\n",
                                         ",,,\n",
                                         std::string(100'000, '1') + "\n"};
  for (std::size_t i = 0; i < rows.size(); ++i)
    write(folder.path() / std::string("r").append(std::to_string(i)).append(".csv"),
          std::string("t_s,x_m,y_m\n").append(rows[i]));
  Result<Files> files = Files::of_folder(folder.path());
  const nlohmann::json list = nlohmann::json::parse(files->list());
  ASSERT_EQ(list["recordings"].size(), rows.size());
  for (const auto& one : list["recordings"])
    EXPECT_TRUE(one.contains("error")) << one;
}

TEST(ConsolePage, PolicyHasTheHashOfTheImportMap) {
  // sha256 of {"imports":{}} by: printf '{"imports":{}}' | openssl dgst -sha256 -binary | base64
  constexpr const char* kTag = R"(<script type="importmap">)";
  EXPECT_EQ(script_hashes(R"(<script type="importmap">{"imports":{}}</script>)", kTag),
            " 'sha256-URrTy+Il/Nz0lHojVUx275hWqAWhkSF0VsHbUM4/6Hw='");
  EXPECT_EQ(script_hashes("<script>alert(1)</script>", kTag), "");
  EXPECT_EQ(script_hashes(R"(<script type="importmap">{)", kTag), "");
  const test::TemporaryFolder folder;
  EXPECT_FALSE(PageFiles::read(folder.path()));
  write(folder.path() / "index.html", "<p>page</p>");
  write(folder.path() / "package.json", "{}");
  const Result<PageFiles> bare = PageFiles::read(folder.path());
  ASSERT_TRUE(bare);
  EXPECT_NE(bare->find("/")->bytes.find("scripts/setup console"), std::string::npos);
  EXPECT_EQ(bare->find("/package.json"), nullptr);
  EXPECT_EQ(bare->find("/../index.html"), nullptr);
  write(folder.path() / "hand/b.js", "2");
  EXPECT_EQ(PageFiles::read(folder.path())->find("/")->bytes, bare->find("/")->bytes);
  write(folder.path() / "vendor/a.js", "1");
  const Result<PageFiles> whole = PageFiles::read(folder.path());
  ASSERT_TRUE(whole && whole->find("/vendor/a.js") != nullptr &&
              whole->find("/hand/b.js") != nullptr);
  EXPECT_EQ(whole->find("/")->bytes, "<p>page</p>");
}

TEST(ConsoleContainer, ArraysBeginAtAMultipleOf8) {
  for (std::size_t length = 0; length < 20; ++length) {
    Arrays arrays;
    const std::vector<float> odd = {1, 2, 3};
    const std::vector<double> wide = {4};
    EXPECT_EQ(arrays.add(odd)[0], 0U);
    EXPECT_EQ(arrays.add(wide)[0], 16U);
    const std::string bytes = arrays.with_json(std::string(length, 'x'));
    std::uint32_t size = 0;
    std::memcpy(&size, bytes.data(), sizeof size);
    EXPECT_EQ((4 + size) % 8, 0U);
    EXPECT_EQ(bytes.size(), 4 + size + 24);
  }
}

bool ends_soon(Process& process) {
  for (int i = 0; i < 5000 && !process.has_ended(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return process.has_ended();
}

TEST(ConsoleProcess, ItsEndAndItsOutput) {
  const test::TemporaryFolder folder;
  const auto log = folder.path() / "log";
  Result<Process> process = Process::start({"/bin/sh", "-c", "echo said; exit 3"}, log);
  ASSERT_TRUE(process);
  ASSERT_TRUE(ends_soon(*process));
  EXPECT_EQ(process->end(), "exit code 3");
  EXPECT_EQ(process->exit_code(), 3);
  EXPECT_EQ(std::filesystem::status(log).permissions(), std::filesystem::perms(0600));
  std::string said;
  std::ifstream(log) >> said;
  EXPECT_EQ(said, "said");
  Result<Process> killed = Process::start({"/bin/sleep", "100"}, log);
  ASSERT_TRUE(killed);
  EXPECT_FALSE(killed->has_ended());
  const auto ticks = killed->start_ticks();
  EXPECT_TRUE(Process::adopt(killed->pid(), ticks));
  EXPECT_FALSE(Process::adopt(killed->pid(), ticks + 1)) << "another process with this number";
  killed->signal(SIGKILL);
  ASSERT_TRUE(ends_soon(*killed));
  EXPECT_EQ(killed->end(), "signal 9");
  EXPECT_FALSE(Process::start({"/no/such/program"}, log));
}

// The devices of trocar-console --device, and what pages do not see of them.

TEST(DeviceChoice, UriWithOptionsInAnyOrder) {
  const auto plain = parse_device_choice("haply:");
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->name, "haply:");
  EXPECT_TRUE(plain->words.empty());
  EXPECT_FALSE(plain->is_simulated());
  const auto full =
      parse_device_choice("udp:[::1]:4840,simulated,key-file=/a=b/k,device-description=d.json");
  ASSERT_TRUE(full);
  EXPECT_EQ(full->name, "udp:[::1]:4840");
  EXPECT_EQ(full->words, (std::vector<std::string>{"--simulated", "--key-file", "/a=b/k",
                                                   "--device-description", "d.json"}));
  EXPECT_TRUE(full->is_simulated() && full->can_be_tested());
  const auto limited = parse_device_choice("haply:,force-limit=3,force-scale=0.2");
  ASSERT_TRUE(limited);
  EXPECT_EQ(limited->words,
            (std::vector<std::string>{"--force-limit", "3", "--force-scale", "0.2"}));
  for (const char* own : {"inproc", "sim"}) {
    const auto simulated = parse_device_choice(own);
    EXPECT_TRUE(simulated && simulated->is_simulated() && !simulated->can_be_tested()) << own;
  }
}

TEST(DeviceChoice, RefusesOtherOptions) {
  for (const char* wrong :
       {"udp:a:1,", "udp:a:1,,simulated", "udp:a:1,key-file", "udp:a:1,key-file=",
        "haply:,force-limit", "haply:,force-limit=", "udp:a:1,simulated=", "udp:a:1,simulated=1",
        "udp:a:1,Simulated", "udp:a:1,--live=x", "udp:a:1,late-ticks-in-row=0",
        "udp:a:1, simulated", "udp:a:1,simulated,simulated", "udp:a:1,key-file=x,key-file=x"}) {
    const auto choice = parse_device_choice(wrong);
    ASSERT_FALSE(choice) << wrong;
    EXPECT_EQ(choice.error().code, ExitCode::kUsage);
    EXPECT_EQ(choice.error().message.find('\n'), std::string::npos);
  }
}

TEST(HiddenTexts, ReplacesTheLongestFirst) {
  HiddenTexts hidden;
  hidden.add("/data/", "");
  hidden.add("/data/sessions/", "sessions/");
  hidden.add("", "nothing");
  const auto device = parse_device_choice("udp:a:1,simulated,key-file=/data/secret.key");
  ASSERT_TRUE(device);
  hidden.add(*device);
  EXPECT_EQ(hidden.hide("/data/sessions/1/log, /data/a.json, /data/secret.key: no"),
            "sessions/1/log, a.json, the file of key-file: no");
  EXPECT_EQ(hidden.hide("nothing to hide"), "nothing to hide");
}

TEST(HiddenTexts, KeepsNamesWithoutFolder) {
  HiddenTexts hidden;
  const auto device = parse_device_choice("udp:a:1,key-file=k");
  ASSERT_TRUE(device);
  hidden.add(*device);
  EXPECT_EQ(hidden.hide("k is kept"), "k is kept");
}

// The contract of HandHolder.

struct TwoClients {
  HandHolder hand;
  int first = 0, second = 0;
  HandHolder::Clock::time_point now = HandHolder::Clock::time_point(std::chrono::hours(1));
};

TEST(HandHolder, SilenceOfASecondFreesIt) {
  TwoClients t;
  EXPECT_FALSE(t.hand.lose_silent(t.now));
  t.hand.move(&t.first, 1, t.now);
  // Another client's messages, and old ones, are silence.
  for (int i = 1; i < 10; ++i) {
    t.hand.move(&t.second, static_cast<std::uint64_t>(i), t.now + milliseconds(100 * i));
    t.hand.move(&t.first, 1, t.now + milliseconds(100 * i));
  }
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(999)));
  EXPECT_TRUE(t.hand.lose_silent(t.now + milliseconds(1000)));
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(1000)));
  EXPECT_EQ(t.hand.share_of(&t.first), HandShare::kFree);
  EXPECT_TRUE(t.hand.move(&t.first, 1, t.now + milliseconds(1001))) << "numbers begin anew";
}

TEST(HandHolder, AFloodIsThinnedOut) {
  TwoClients t;
  std::uint64_t number = 0;
  int used = 0;
  for (int us = 0; us < 4'000'000; us += 100)  // 10,000 messages a second
    used += t.hand.move(&t.first, ++number, t.now + std::chrono::microseconds(us)) ? 1 : 0;
  EXPECT_GE(used, 495);
  EXPECT_LE(used, 505);
  EXPECT_FALSE(t.hand.lose_silent(t.now + milliseconds(4500))) << "dropped ones are no silence";
}

TEST(HandHolder, EveryFrameOfAPageIsUsed) {
  TwoClients t;
  std::uint64_t number = 0;
  for (int frame = 0; frame < 600; ++frame) {  // 60 a second, which arrive up to 12 ms late
    const int us = frame * 16'667 + frame % 4 * 4000;
    ASSERT_TRUE(t.hand.move(&t.first, ++number, t.now + std::chrono::microseconds(us))) << frame;
  }
}

TEST(ForceHistory, KeepsEveryPointWhileThereAreFew) {
  ForceHistory history;
  for (int i = 0; i < 100; ++i)
    history.add({0.004 * i, 1.0 * i, -1e-3 * i});
  ASSERT_EQ(history.points().size(), 100U);
  EXPECT_EQ(history.points()[37].force_N, 37);
  EXPECT_EQ(history.points()[37].tip_z_m, -0.037);
  history.add({0.1, 999, 0});
  history.add({std::nan(""), 999, 0});
  EXPECT_EQ(history.points().size(), 100U) << "time goes forward";
  history.clear();
  EXPECT_TRUE(history.points().empty());
  history.add({0, 1, 0});
  EXPECT_EQ(history.points().size(), 1U);
}

// An hour at 250 snapshots a second, with short peaks.
TEST(ForceHistory, AnHourIsSmallAndKeepsItsPeaks) {
  ForceHistory history;
  constexpr int kSnapshots = 900'000, kEvery = 45'000;
  for (int i = 0; i < kSnapshots; ++i) {
    const int peak = i / kEvery;
    history.add({0.004 * i, i % kEvery == kEvery / 2 ? 50.0 + peak : 1.0, 0});
  }
  EXPECT_LE(history.points().size(), ForceHistory::kMaxPoints);
  EXPECT_GT(history.points().size(), ForceHistory::kMaxPoints / 4);
  int peaks = 0;
  double last_t_s = -1;
  for (const ForceHistory::Point& point : history.points()) {
    EXPECT_GT(point.t_s, last_t_s);
    last_t_s = point.t_s;
    if (point.force_N == 1) continue;
    EXPECT_EQ(point.force_N, 50 + peaks);
    ++peaks;
  }
  EXPECT_EQ(peaks, kSnapshots / kEvery);
}

// Points are removed when there is one more than kMaxPoints, so the newest one has no partner.
TEST(ForceHistory, APeakThatFillsTheHistoryStays) {
  ForceHistory history;
  constexpr auto kMost = static_cast<int>(ForceHistory::kMaxPoints);
  for (int i = 0; i <= kMost; ++i)
    history.add({0.004 * i, i == kMost ? 50.0 : 1.0, 0});
  ASSERT_FALSE(history.points().empty());
  EXPECT_EQ(history.points().back().force_N, 50);
}

// The events that the console finds in a recording.

/// Returns the JSON of the console's answer for a recording of these rows, at 1 kHz.
json answer_for(std::vector<RecordingRow> rows, const char* device_kind = "legs") {
  const test::TemporaryFolder folder;
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].t_s = static_cast<double>(i) / 1000;
  RecordingOrigin origin;
  origin.entries = {
      {"rate_Hz", "1000"}, {kOriginXray, "counted"}, {kOriginDeviceKind, device_kind}};
  auto writer = RecordingWriter::open(folder / "r.csv", origin);
  EXPECT_TRUE(writer && writer->append(rows) && writer->commit());
  const auto answer = rows_of(folder / "r.csv");
  EXPECT_TRUE(answer) << answer.error().message;
  std::uint32_t size = 0;
  std::memcpy(&size, answer->data(), sizeof size);
  return json::parse(answer->substr(sizeof size, size));
}

json events_of(std::vector<RecordingRow> rows) {
  return answer_for(std::move(rows))["events"];
}

TEST(Rows, AnEmergencyStopDuringTheRecoveryFromAnotherOneIsAnEventOfItsOwn) {
  std::vector<RecordingRow> rows;
  const auto add = [&rows](SafetyState safety, Fault fault) {
    RecordingRow row;
    row.safety = safety;
    row.fault = fault;
    rows.push_back(row);
  };
  add(SafetyState::kRunning, Fault::kNone);
  for (int i = 0; i < 2; ++i) {
    add(SafetyState::kFault, Fault::kEmergencyStop);
    add(SafetyState::kFault, Fault::kEmergencyStop);
    add(SafetyState::kRecovering, Fault::kEmergencyStop);
  }
  add(SafetyState::kReady, Fault::kNone);
  std::vector<std::pair<std::string, double>> found;
  for (const json& event : events_of(rows))
    found.emplace_back(event["kind"].get<std::string>(), event["t_s"].get<double>());
  const std::vector<std::pair<std::string, double>> expected = {
      {"fault", 0.001}, {"fault", 0.004}, {"recovered", 0.007}};
  EXPECT_EQ(found, expected);
}

TEST(Rows, ARecordingOfAPoseDeviceHasNoTorquesAndNoAnglesOfMotors) {
  for (const char* kind : {"legs", "pose"}) {
    std::set<std::string> names;
    std::size_t width = 0;
    const json answer = answer_for(std::vector<RecordingRow>(3), kind);
    for (const json& column : answer["columns"]) {
      names.insert(column["name"].get<std::string>());
      width += column["count"].get<std::size_t>();
    }
    EXPECT_EQ(answer["rows_at"][1].get<std::size_t>(), 3 * width);
    EXPECT_TRUE(names.contains("wrench_delivered"));
    for (const char* of_motors : {"tau_Nm", "motor_angle_rad"})
      EXPECT_EQ(names.contains(of_motors), std::string(kind) == "legs") << of_motors;
  }
}

TEST(Rows, TheNumberOfEventsIsBounded) {
  std::vector<RecordingRow> rows(19'999);
  for (std::size_t i = 0; i < rows.size(); i += 2)
    rows[i].xray = kXrayBeam;  // each row switches it on or off
  RecordingRow row;
  row.xray = kXrayPicture;
  rows.insert(rows.end(), 1001, row);  // the first of these is a picture and the end of screening
  EXPECT_EQ(events_of(rows).size(), 20'001U);
}

}  // namespace
}  // namespace trocar::runtime
