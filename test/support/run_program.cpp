// SPDX-License-Identifier: BSD-3-Clause
#include "support/run_program.h"

#include "support/text_files.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <stdexcept>
#include <thread>

namespace dsorb {
namespace {

void redirect(const std::filesystem::path& file, int descriptor) {
  const int opened = open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (opened < 0 || dup2(opened, descriptor) < 0) _exit(126);
}

}  // namespace

ProgramResult runProgram(const std::vector<std::string>& arguments,
                         const std::filesystem::path& working_folder,
                         const std::function<bool()>& interrupt_when) {
  const std::filesystem::path out = working_folder / "stdout.txt";
  const std::filesystem::path err = working_folder / "stderr.txt";
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error("fork failed");
  if (child == 0) {
    redirect(out, STDOUT_FILENO);
    redirect(err, STDERR_FILENO);
    if (chdir(working_folder.c_str()) != 0) _exit(126);
    execv(argv[0], argv.data());
    _exit(127);
  }
  int status = 0;
  bool asked = !interrupt_when;
  while (waitpid(child, &status, WNOHANG) == 0) {
    if (!asked && interrupt_when()) {
      kill(child, SIGINT);
      asked = true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, readText(out), readText(err)};
}

}  // namespace dsorb
