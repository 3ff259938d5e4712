// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/disk_reserve.h"

#include <fcntl.h>

#include <cerrno>
#include <string>

#include "formats/base/system_message.h"

namespace trocar::runtime {

Result<DiskReserve> DiskReserve::hold(const std::filesystem::path& folder) {
  DiskReserve reserve;
  FileDescriptor file(::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600));
  // Unlike posix_fallocate(), this never writes the bytes one by one.
  if (file.get() >= 0 && ::fallocate(file.get(), 0, 0, static_cast<off_t>(kBytes)) == 0) {
    reserve.file_.emplace(std::move(file));
  } else if (errno == ENOSPC || errno == EDQUOT) {
    return unwritable(folder.string() +
                      ": less than 1 MiB is free on the disk: " + system_message(errno));
  }
  return reserve;
}

}  // namespace trocar::runtime
