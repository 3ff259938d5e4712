// SPDX-License-Identifier: GPL-3.0-or-later
// trocar-mesh with failpoints that act. The environment variable TROCAR_FAILPOINT is WHO:WHERE or
// WHO:WHERE:stop. WHO is `worker` (the process of a scan), `batch` (its parent) or `both` (a worker
// that first kills its parent). WHERE is the name of a failpoint, or a number k for the k-th
// failpoint that the process reaches, from 1. At its first match the process is killed by SIGKILL,
// or with `stop` stopped by SIGSTOP. Without the variable the program is trocar-mesh.
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <sstream>
#include <string>

#include "pipeline/batch/store.h"
#include "pipeline/program/trocar_mesh.h"

namespace {

struct Wanted {
  std::string who, where, how;
} wanted;
pid_t batch = 0, counted = 0;  // `counted`: the process that `reached` belongs to
int reached = 0;
bool done = false;

void act(const char* name) {
  if (const pid_t own = ::getpid(); own != counted) {
    counted = own;
    reached = 0;
    done = false;
  }
  if (done) return;
  ++reached;
  const bool is_mine = (counted == batch) == (wanted.who == "batch");
  if (!is_mine || (wanted.where != name && wanted.where != std::to_string(reached))) return;
  done = true;
  if (wanted.how == "stop") {
    ::raise(SIGSTOP);
    return;
  }
  if (wanted.who == "both") ::kill(::getppid(), SIGKILL);
  ::raise(SIGKILL);
}

}  // namespace

int main(int argc, char** argv) {
  if (const char* const text = std::getenv("TROCAR_FAILPOINT")) {  // NOLINT(concurrency-mt-unsafe)
    std::istringstream words(text);
    std::getline(words, wanted.who, ':');
    std::getline(words, wanted.where, ':');
    std::getline(words, wanted.how);
    batch = ::getpid();
    trocar::farm::failpoint_hook = act;
  }
  return trocar::pipeline::trocar_mesh(argc, argv);
}
