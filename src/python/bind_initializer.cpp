// SPDX-License-Identifier: BSD-3-Clause
#include "python/bind.h"
#include "python/initialization.h"
#include "python/options.h"
#include "python/priors.h"
#include "python/unlocked.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <utility>

namespace dsorb::python {

Initialization::Initialization(const InitializationResult& result)
    : report(result.report), metric(result.metric) {
  for (const PosedFrame& posed : result.frames) {
    frames.push_back({posed.frame->id().value,
                      posed.frame->timestamp(),
                      posed.T_cam_ref,
                      posed.affine,
                      posed.covariance});
  }
  for (const InitPoint& point : result.points) {
    points.hosts.push_back(point.host);
    points.add(point.pixel, point.inverse_depth, point.variance);
  }
  for (const Eigen::Vector2f& pixel : result.stuck) stuck.emplace_back(pixel.x(), pixel.y());
}

namespace {

/// What a frame led to.
struct Step {
  InitStatus status;
  InitReason reason;
  std::optional<Initialization> result;
  std::optional<WaitingMotion> motion;
};

const char* nameOf(InitStatus status) {
  switch (status) {
    case InitStatus::kRestarted:
      return "restarted";
    case InitStatus::kInitialized:
      return "initialized";
    case InitStatus::kNeedsMoreFrames:
      break;
  }
  return "needs_more_frames";
}

/// Calls of several threads wait for each other.
class LockedInitializer {
 public:
  std::atomic<bool> hurried{false};

  LockedInitializer(FrameSource source, const Config& config)
      : source_(std::move(source)),
        initializer_(makeInitializer(optionsOf(config), source_.camera())) {}

  Step add(nb::handle image,
           double timestamp,
           std::optional<int> id,
           double exposure,
           const Priors* priors) {
    const AnyArray array = arrayFrom(image);
    const ImageView view = rectifiedView(array);
    const auto known = sharedPriors(priors);
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(mutex_);
    const FrameInfo info = source_.next(timestamp, id, exposure, known);
    initializer_->setHurried(hurried);
    const InitStep step =
        source_.given(info.id, [&] { return initializer_->addFrame(Frame::create(view, info)); });
    Step answer{step.status, step.reason, std::nullopt, step.motion};
    if (step.result) answer.result.emplace(*step.result);
    return answer;
  }
  void reset() {
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(mutex_);
    initializer_->reset();
    source_.reset();
  }

 private:
  static InitializerOptions optionsOf(const Config& config) {
    InitializerOptions options = config.options.initializer;
    options.num_threads = config.options.num_threads;
    return options;
  }
  std::mutex mutex_;
  FrameSource source_;
  std::unique_ptr<Initializer> initializer_;
};

nb::object motionOf(const std::optional<WaitingMotion>& motion) {
  if (!motion) return nb::none();
  nb::dict dict;
  dict["reference"] = motion->reference.value;
  dict["T_cam_ref"] = matrixOf(motion->T_cam_ref);
  dict["covariance"] = covarianceOf(motion->covariance);
  dict["wrong_probability"] = motion->wrong_probability;
  return std::move(dict);
}

nb::dict reportOf(const InitReport& report) {
  nb::dict stages;
  for (const StageTime& stage : report.stages) stages[stage.stage.c_str()] = stage.milliseconds;
  nb::list resets;
  for (const InitReason reason : report.earlier_resets) resets.append(name(reason));
  nb::dict details;
  for (const Detail& detail : report.details) details[detail.name.c_str()] = detail.value;
  nb::dict dict;
  dict["restarts"] = report.restarts;
  dict["model"] = report.model;
  dict["median_relative_sigma"] = report.median_relative_sigma;
  dict["wrong_probability"] = report.wrong_probability;
  dict["depth_prior_used"] = report.depth_prior;
  dict["pose_prior_used"] = report.pose_prior;
  dict["milliseconds"] = stages;
  dict["earlier_resets"] = resets;
  dict["details"] = details;
  return dict;
}

void bindStart(nb::module_& m) {
  nb::class_<StartFrame> frame(m, "StartFrame", "One of the frames of a start.");
  bindRepr(frame, {"id", "timestamp"});
  frame.def_ro("id", &StartFrame::id)
      .def_ro("timestamp", &StartFrame::timestamp)
      .def_prop_ro(
          "T_cam_ref",
          [](const StartFrame& f) { return matrixOf(f.T_cam_ref); },
          nb::rv_policy::automatic,
          "(4, 4): maps points of the reference camera to this one; None: could not be posed.")
      .def_prop_ro(
          "brightness",
          [](const StartFrame& f) { return std::make_pair(f.affine.a, f.affine.b); },
          "Log gain [-] and offset [grey levels] relative to the reference.")
      .def_prop_ro(
          "covariance",
          [](const StartFrame& f) { return covarianceOf(f.covariance); },
          nb::rv_policy::automatic,
          "(6, 6) of exp(xi) * T_cam_ref, [translation; rotation]; or None.");

  nb::class_<Initialization> type(m,
                                  "Initialization",
                                  "First poses and points. The first frame is the reference; the "
                                  "mean inverse depth of its points is 1.");
  type.def_ro("frames", &Initialization::frames)
      .def_prop_ro(
          "hosts",
          [](Initialization& i) { return Hosts(i.points.hosts.data(), {i.points.hosts.size()}); },
          nb::rv_policy::reference_internal,
          "(n,): index of each point's host in `frames`.")
      .def_prop_ro(
          "metric",
          [](const Initialization& i) -> std::optional<std::pair<double, double>> {
            if (!i.metric) return std::nullopt;
            return std::make_pair(i.metric->metres, i.metric->relative_sigma);
          },
          "Metres of one unit and their relative standard deviation, where priors give them; or "
          "None.")
      .def_ro("stuck",
              &Initialization::stuck,
              "Pixels (x, y) that move with the camera, as a bonnet does.")
      .def_prop_ro("report", [](const Initialization& i) { return reportOf(i.report); });
  bindPoints(type);
  bindRepr(type, {"frames", "metric"});
}

}  // namespace

void bindInitializer(nb::module_& m) {
  bindStart(m);
  nb::class_<Step> step(m, "InitStep", "What a frame led to.");
  bindRepr(step, {"status", "reason"});
  step.def_prop_ro(
          "status",
          [](const Step& s) { return nameOf(s.status); },
          "needs_more_frames, restarted or initialized.")
      .def_prop_ro("reason", [](const Step& s) { return name(s.reason); })
      .def_ro("result", &Step::result, "The start; None before.")
      .def_prop_ro(
          "motion",
          [](const Step& s) { return motionOf(s.motion); },
          nb::sig("def motion(self) -> dict | None"),
          "While orb waits and an attempt with this frame came to the gate: the motion as a dict "
          "(reference, T_cam_ref, covariance, wrong_probability); else None.");

  nb::class_<LockedInitializer> type(
      m, "Initializer", "Finds the first poses and depths from frames given one by one.");
  bindMaker(type,
            "`initializer`: orb (default) or coarse. Options as dictionary or keywords: "
            "Initializer(camera, orb={'min_frames': 6}, seed=3). Raises ConfigError.");
  bindFeeder(type,
             "add",
             &LockedInitializer::add,
             "Gives the next rectified image, (height, width) of uint8 or float32, in time order. "
             "After a result, reset() comes first.");
  bindRepr(type, {});
  type.def("reset", &LockedInitializer::reset, "Makes the object equal to a fresh one.");
  m.def("initializer_names", &initializerVariants, "Initializers of this build.");
}

}  // namespace dsorb::python
