// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/journal.h"

#include <fcntl.h>
#include <unistd.h>

#include <chrono>
#include <ctime>
#include <string>

#include "formats/base/json_text.h"
#include "formats/base/text_line.h"
#include "formats/base/utc_time.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/failpoint.h"
#include "pipeline/farm/process_identity.h"

namespace trocar::farm {
namespace {

std::string time_text() {
  using namespace std::chrono;
  const auto now = system_clock::now();
  const auto ms = duration_cast<milliseconds>(now.time_since_epoch()).count() % 1000;
  std::string out = utc_text(system_clock::to_time_t(now));
  out.pop_back();  // the Z
  return out + text_line(".%03dZ", static_cast<int>(ms));
}

}  // namespace

bool Journal::add(nlohmann::json line) {
  const ProcessIdentity me = this_process();
  if (!fd_ || fd_->get() < 0) {
    const std::string name =
        me.host + "-" + std::to_string(me.pid) + "-" + std::to_string(me.start) + ".ndjson";
    // Private, because reasons and warnings state the paths of the input, which may name patients.
    fd_.emplace(::open((folder_ / name).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    if (fd_->get() < 0 || !give_to_users(fd_->get(), folder_, 0600)) return false;
  }
  line["time"] = time_text();
  line["host"] = me.host;
  line["pid"] = me.pid;
  failpoint("journal");
  const std::string text = json_text(line) + "\n";
  return ::write(fd_->get(), text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

}  // namespace trocar::farm
