// SPDX-License-Identifier: BSD-3-Clause
#include "app/run_outputs.h"

#include "dsorb/error.h"

#include "io/output/output_file.h"

#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <system_error>
#include <utility>

namespace dsorb::app {

namespace fs = std::filesystem;

RunOutputs::RunOutputs(const CommandLine& request, RunInfo info)
    : folder_(request.output),
      record_(request.record),
      write_result_txt_(request.write_result_txt),
      info_(std::move(info)) {
  if (record_.empty()) return;
  io::refuseOthers(record_);
  std::error_code none;
  const fs::path place = fs::weakly_canonical(record_, none);
  if (io::isOutputFile(place.lexically_relative(fs::weakly_canonical(folder_, none)))) {
    throw ConfigError(fmt::format(
        "--record {}: the run itself writes a file of this name; choose another", record_));
  }
}

void RunOutputs::open(const PinholeCamera& camera,
                      const Lens& lens,
                      const std::string& config_yaml) {
  const Lock lock(mutex_);
  info_.config_yaml = config_yaml;
  run_.emplace(folder_, info_);
  run_->setCamera(camera, &lens);
  if (!record_.empty()) recording_.emplace(record_, info_, camera);
}

void RunOutputs::setFoundCamera(const FoundCamera& camera) {
  const Lock lock(mutex_);
  run_->setFoundCamera(camera);
}

void RunOutputs::frameDone(const FrameTiming& timing,
                           const FrameEstimate& estimate,
                           const std::string& image_file) {
  const Lock lock(mutex_);
  run_->frameDone(timing, image_file);
  if (recording_) recording_->frameDone(estimate);
}

void RunOutputs::setDropped(int frames) {
  const Lock lock(mutex_);
  run_->setDropped(frames);
}

void RunOutputs::setUnreadable(const std::vector<std::string>& files) {
  const Lock lock(mutex_);
  run_->setUnreadable(files);
}

void RunOutputs::finish(RunStatus status, const OdometryReport* report) {
  const Lock lock(mutex_);
  finishLocked(status, report);
}

std::optional<RunStatus> RunOutputs::finishNow(std::chrono::milliseconds patience) {
  if (!mutex_.try_lock_for(patience)) return std::nullopt;  // never unlocked
  const RunStatus outcome = run_ ? run_->outcome() : RunStatus::kNeverInitialized;
  finishLocked(RunStatus::kInterrupted, nullptr);
  return outcome;
}

void RunOutputs::finishLocked(RunStatus status, const OdometryReport* report) {
  if (!run_) run_.emplace(folder_, info_);
  run_->finish(status, report);
  if (recording_) recording_->finish(status);
  if (write_result_txt_ && status != RunStatus::kError) run_->writeKeyframes("result.txt");
}

RunStatus RunOutputs::outcome() const {
  const Lock lock(mutex_);
  return run_ ? run_->outcome() : RunStatus::kNeverInitialized;
}

}  // namespace dsorb::app
