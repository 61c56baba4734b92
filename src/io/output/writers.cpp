// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/writers.h"

#include "base/timed.h"
#include "io/output/figures.h"
#include "io/output/frame_table.h"
#include "io/output/initialization_writer.h"
#include "io/output/output_file.h"
#include "io/output/points_ply.h"
#include "io/output/run_json.h"
#include "io/output/run_record.h"
#include "io/output/tracks_ply.h"
#include "io/output/trajectory_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

/// What run.json says until finish(): the run was killed.
std::string firstSummary(const RunInfo& info) {
  return io::jsonText(io::runJson(info, {}, io::RunRecord({}), {}));
}

/// Keyframes from which on the files that are replaced as a whole are worth it again: each a tenth
/// after the one before, so that writing stays linear in the length of the run.
std::size_t nextWriting(std::size_t keyframes) {
  return keyframes + std::max<std::size_t>(1, keyframes / 10);
}

}  // namespace

class RunWriter::Impl {
 public:
  Impl(const std::string& folder_name, const RunInfo& run_info)
      : folder(folder_name),
        prepared(folder, run_info.program, firstSummary(run_info)),
        info(run_info),
        record(folder),
        frames_csv(folder / "frames.csv"),
        trajectory(folder, "trajectory"),
        keyframes(folder, "keyframes"),
        initializations(folder / "initialization.json", run_info.initializer),
        points(folder) {
    frames_csv.append(io::frameTableHeader());
    io::replaceFile(folder / "config.yaml", info.config_yaml);
  }

  void writeFrame(const FrameTiming& timing, const std::string& image_file) {
    frames_csv.append(io::frameTableLine(*record.estimate(), timing.work_milliseconds, image_file));
    trajectory.update(record, record.frames());
    keyframes.update(record, record.keyframes());
    initializations.update(record, timing.work_milliseconds);
    writeInitialFigures();
    const std::size_t count = record.keyframes().size();
    if (!keyframes_changed || count < next_writing) return;
    points.update();
    next_writing = nextWriting(count);
    writeRunJson(RunStatus::kError, nullptr);
    keyframes_changed = false;
  }

  /// All but run.json, once the run has ended.
  void writeFinalFiles(RunStatus outcome) {
    trajectory.finish(record, record.frames());
    keyframes.finish(record, record.keyframes());
    if (record.segments().size() == 1 && outcome == RunStatus::kTracked) {
      io::writeKitti(folder / "trajectory_kitti.txt", record, record.frames());
    }
    points.update();
    io::writePng(folder / "figures" / "trajectory.png", io::drawTrajectory(record));
    io::writePng(folder / "figures" / "timeline.png", io::drawTimeline(record));
    writeCalibration();
  }

  void writeInitialFigures() const {
    for (const io::InitStepNote& step : record.steps()) {
      if (!step.result || step.refusal) continue;
      const std::string suffix = step.segment == 0 ? "" : fmt::format("_{}", step.segment);
      io::writePng(folder / "figures" / ("initial_inverse_depth" + suffix + ".png"),
                   io::drawInverseDepth(*step.result));
    }
  }

  /// Calibration that the run refined; empty where it is not settled, or of no form of ours.
  [[nodiscard]] std::string refinedCalibration() const {
    if (!cameras.camera || !cameras.lens || !cameras.areSettled()) return {};
    Lens lens = *cameras.lens;
    if (cameras.readout) lens.readout = *cameras.readout;
    return cameras.refined.calibrationFile(lens, *cameras.camera);
  }

  /// Writes the calibration for the next run: the one that was refined, or else the one that was
  /// found before.
  void writeCalibration() const {
    std::string file = refinedCalibration();
    if (file.empty() && cameras.found && cameras.found->isKnown()) {
      file = io::calibrationFile(cameras.found->lens);
    }
    if (!file.empty()) io::replaceFile(folder / "refined_camera.txt", file);
  }

  void writeRunJson(RunStatus status, const OdometryReport* report) const {
    io::RunSeconds written = seconds;
    written.total = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (report != nullptr) {
      written.initializing = report->initializing_seconds;
      written.tracking = report->tracking_seconds;
      written.mapping = report->mapping_seconds;
    }
    const io::Json json =
        io::runJson(info, cameras, record, {status, frames_dropped, unreadable, written});
    io::replaceFile(folder / "run.json", io::jsonText(json));
  }

  fs::path folder;
  io::OutputFolder prepared;  // before any member opens a file there
  RunInfo info;
  io::RunCameras cameras;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  io::RunSeconds seconds;
  io::RunRecord record;
  io::GrowingFile frames_csv;
  io::TrajectoryWriter trajectory;
  io::TrajectoryWriter keyframes;
  io::InitializationWriter initializations;
  io::PointsPly points;
  bool keyframes_changed = false;
  std::size_t next_writing = 0;  // number of keyframes
  int frames_dropped = 0;
  std::vector<std::string> unreadable;
};

RunWriter::RunWriter(const std::string& folder, const RunInfo& info)
    : impl_(std::make_unique<Impl>(folder, info)) {}
RunWriter::~RunWriter() = default;

void RunWriter::setCamera(const PinholeCamera& camera, const Lens* lens) {
  impl_->cameras.camera = camera;
  if (lens != nullptr) impl_->cameras.lens = *lens;
  impl_->initializations.setCamera(camera);
}

void RunWriter::setFoundCamera(const FoundCamera& camera) {
  impl_->cameras.found = camera;
}

void RunWriter::setConfig(const std::string& yaml) {
  io::replaceFile(impl_->folder / "config.yaml", yaml);
}

void RunWriter::onInitStep(const InitStep& step, const Frame& /*frame*/, int segment) {
  impl_->record.addInitStep(step, segment);
}

void RunWriter::onStartRefused(const StartRefusal& refusal) {
  impl_->record.addRefusal(refusal);
}

void RunWriter::onSegmentsJoined(const SegmentsJoined& joined) {
  impl_->record.addJoin(joined);
  impl_->points.change(impl_->record.changes());
}

void RunWriter::onLoopsClosed(const LoopsClosed& closed) {
  impl_->record.addLoops(closed);
  impl_->points.change(impl_->record.changes());
}

void RunWriter::onTracks(const std::vector<MapTrack>& tracks) {
  io::writeTracks(impl_->folder / "tracks.ply", tracks);
}

void RunWriter::onFrame(const FrameEstimate& estimate) {
  impl_->record.addFrame(estimate);
}

void RunWriter::onKeyframe(const KeyframeSnapshot& keyframe) {
  impl_->record.addKeyframe(keyframe);
  impl_->points.setKeyframe(keyframe);
  impl_->cameras.refined.add(keyframe);
  if (keyframe.readout) impl_->cameras.readout = keyframe.readout;
  impl_->keyframes_changed = true;
}

void RunWriter::onKeyframeRetired(const KeyframeSnapshot& keyframe) {
  impl_->record.addKeyframe(keyframe);
  impl_->points.retireKeyframe(keyframe);
  impl_->keyframes_changed = true;
}

void RunWriter::frameDone(const FrameTiming& timing, const std::string& image_file) {
  Impl& run = *impl_;
  run.seconds.reading += timing.reading_milliseconds * 1e-3;
  if (!run.record.estimate()) return;
  const OdometryState state = run.record.estimate()->state;
  const bool initializing =
      state == OdometryState::kInitializing || state == OdometryState::kInitialized;
  (initializing ? run.seconds.initializing : run.seconds.tracking) +=
      timing.work_milliseconds * 1e-3;
  run.record.setMilliseconds(timing.work_milliseconds);

  timed(run.seconds.writing, [&] { run.writeFrame(timing, image_file); });
  run.record.nextFrame();
}

void RunWriter::setDropped(int frames) {
  impl_->frames_dropped = frames;
}

void RunWriter::setUnreadable(std::vector<std::string> files) {
  impl_->unreadable = std::move(files);
}

RunStatus RunWriter::outcome() const {
  const io::RunRecord& record = impl_->record;
  if (record.segments().empty()) return RunStatus::kNeverInitialized;
  const OdometryState last = record.notes().newest().state;
  const bool map_stands = last != OdometryState::kInitializing && last != OdometryState::kLost;
  if (!map_stands) return RunStatus::kLost;
  const bool most = 2 * record.frames().size() >= record.notes().size();
  return most ? RunStatus::kTracked : RunStatus::kPartlyTracked;
}

bool RunWriter::calibrationSuspected() const {
  return impl_->record.contradictedCamera().has_value();
}

void RunWriter::finish(RunStatus status, const OdometryReport* report) {
  Impl& run = *impl_;
  timed(run.seconds.writing, [&] { run.writeFinalFiles(outcome()); });
  run.writeRunJson(status, report);
}

void RunWriter::writeKeyframes(const std::string& path) const {
  const io::RunRecord& record = impl_->record;
  io::writeTum(path, record, record.keyframes(), record.longestSegment());
}

}  // namespace dsorb
