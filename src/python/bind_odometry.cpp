// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "platform/process.h"
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
#include <cmath>
#include <cstdint>
#include <iomanip>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::python {
namespace {

struct Keyframe {
  Keyframe(const KeyframeSnapshot& snapshot, bool is_final)
      : id(snapshot.id.value),
        timestamp(snapshot.timestamp),
        segment(snapshot.segment),
        final(is_final),
        T_world_cam(snapshot.T_world_cam),
        camera(snapshot.camera),
        readout(snapshot.readout),
        camera_score(snapshot.camera_score) {
    for (const MapPoint& point : snapshot.points) {
      points.add(point.pixel, point.inverse_depth, point.variance);
      points.intensities.push_back(point.intensity);
    }
  }
  int id;
  double timestamp;
  int segment;
  bool final;
  SE3 T_world_cam;
  PinholeCamera camera;
  std::optional<Readout> readout;
  std::optional<CameraScore> camera_score;
  PointColumns points;
};

/// What a call told.
struct Events {
  std::vector<Keyframe> keyframes;
  std::optional<Initialization> initialization;
  std::optional<std::string> refusal;
};

class EventLog : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int /*segment*/) override {
    if (step.result) events_.initialization.emplace(*step.result);
  }
  void onStartRefused(const StartRefusal& refusal) override {
    events_.initialization.reset();
    events_.refusal = name(refusal.reason);
  }
  void onKeyframe(const KeyframeSnapshot& keyframe) override {
    events_.keyframes.emplace_back(keyframe, false);
  }
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override {
    events_.keyframes.emplace_back(keyframe, true);
  }
  Events take() { return std::exchange(events_, {}); }

 private:
  Events events_;
};

struct Estimate {
  FrameEstimate frame;  // without its image
  int id = 0;
  double timestamp = 0;
  Events events;
};

struct Report {
  OdometryReport odometry;
  std::vector<Keyframe> keyframes;
};

/// Calls of several threads wait for each other.
class LockedOdometry {
 public:
  std::atomic<bool> hurried{false};

  LockedOdometry(FrameSource source, const Config& config)
      : source_(std::move(source)),
        odometry_(std::make_unique<Odometry>(source_.camera(), config.options)) {
    odometry_->addObserver(&log_);
    if (config.options.pipelined) process_ = platform::processId();
  }
  ~LockedOdometry() {
    if (isElsewhere()) (void)odometry_.release();  // its destructor would wait for a thread
  }
  LockedOdometry(const LockedOdometry&) = delete;
  LockedOdometry& operator=(const LockedOdometry&) = delete;

  Estimate process(nb::handle image,
                   double timestamp,
                   std::optional<int> id,
                   double exposure,
                   const Priors* priors) {
    const AnyArray array = arrayFrom(image);
    const ImageView view = rectifiedView(array);
    const auto known = sharedPriors(priors);
    requireThreads();
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(mutex_);
    const FrameInfo info = source_.next(timestamp, id, exposure, known);
    Estimate estimate;
    estimate.frame = source_.given(
        info.id, [&] { return odometry_->process(Frame::create(view, info), hurried); });
    estimate.frame.frame = nullptr;
    estimate.id = info.id.value;
    estimate.timestamp = timestamp;
    estimate.events = log_.take();
    return estimate;
  }
  std::vector<Keyframe> restart() {
    requireThreads();
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(mutex_);
    odometry_->restart();
    return log_.take().keyframes;
  }
  Report finish() {
    requireThreads();
    const Unlocked unlocked;
    const std::lock_guard<std::mutex> lock(mutex_);
    const OdometryReport report = odometry_->finish();
    return {report, log_.take().keyframes};
  }

 private:
  /// Whether it is pipelined and fork() has copied it without its thread.
  [[nodiscard]] bool isElsewhere() const { return process_ && *process_ != platform::processId(); }
  void requireThreads() const {
    if (!isElsewhere()) return;
    throw std::runtime_error(
        "a pipelined Odometry has a thread, which stays in the process that made it; after fork() "
        "make another one");
  }

  std::mutex mutex_;
  EventLog log_;
  FrameSource source_;
  std::unique_ptr<Odometry> odometry_;
  std::optional<std::int64_t> process_;  // that made it, where it has a thread
};

using Points3 = nb::ndarray<nb::numpy, double, nb::shape<-1, 3>>;

/// Points in world coordinates; NaN where a depth is not positive.
Points3 worldPoints(const Keyframe& keyframe) {
  std::vector<double> coordinates;
  const std::size_t count = keyframe.points.inverse_depths.size();
  coordinates.reserve(3 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel(keyframe.points.pixels[2 * i], keyframe.points.pixels[2 * i + 1]);
    const auto inverse_depth = static_cast<double>(keyframe.points.inverse_depths[i]);
    const double depth =
        inverse_depth > 0 ? 1 / inverse_depth : std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector3d point = keyframe.T_world_cam * (depth * keyframe.camera.unproject(pixel));
    coordinates.insert(coordinates.end(), point.begin(), point.end());
  }
  return arrayOf<Points3>(std::move(coordinates), {count, 3});
}

void bindKeyframe(nb::module_& m) {
  nb::class_<Keyframe> type(m, "Keyframe", "A keyframe with the points it hosts, as of a moment.");
  type.def_ro("id", &Keyframe::id)
      .def_ro("timestamp", &Keyframe::timestamp)
      .def_ro("segment", &Keyframe::segment)
      .def_ro("final", &Keyframe::final, "Its estimates will not change any more.")
      .def_prop_ro(
          "T_world_cam",
          [](const Keyframe& k) { return matrixOf(k.T_world_cam); },
          nb::rv_policy::automatic,
          "(4, 4): camera to world, which is the reference camera of the segment's start.")
      .def_ro("camera", &Keyframe::camera)
      .def_prop_ro(
          "readout_ms",
          [](const Keyframe& k) -> std::optional<std::pair<double, double>> {
            if (!k.readout) return std::nullopt;
            return std::make_pair(1e3 * k.readout->seconds, 1e3 * k.readout->sigma);
          },
          "Estimated readout of a rolling shutter and its standard deviation [ms], where the "
          "calibration leaves it open; or None.")
      .def_prop_ro(
          "calibration_deviations",
          [](const Keyframe& k) -> std::optional<double> {
            if (!k.camera_score) return std::nullopt;
            return k.camera_score->deviations();
          },
          "By how many standard deviations the first keyframes of the segment contradict the "
          "calibration, above 4 it is suspected; None before there are five, and where the window "
          "estimates the camera.")
      .def_prop_ro(
          "intensities",
          [](Keyframe& k) {
            return Column(k.points.intensities.data(), {k.points.intensities.size()});
          },
          nb::rv_policy::reference_internal,
          "(n,): grey levels.")
      .def("world_points", &worldPoints, "(n, 3): world coordinates of the points, a new array.");
  bindPoints(type);
  bindRepr(type, {"id", "timestamp", "segment", "final"});
}

/// A line for people.
std::string lineOf(const Estimate& e) {
  std::ostringstream line;
  line << std::fixed << std::setprecision(3) << "image " << e.id << " at " << e.timestamp
       << " s: " << name(e.frame.state);
  if (e.frame.T_world_cam) {
    const Eigen::Vector3d p = e.frame.T_world_cam->translation();
    line << " at (" << p.x() << ", " << p.y() << ", " << p.z() << ") of segment "
         << e.frame.segment;
  }
  if (e.frame.world_covariance) {
    const Matrix6d& covariance = *e.frame.world_covariance;
    line << std::defaultfloat << std::setprecision(2) << ", +- "
         << std::sqrt(covariance(0, 0) + covariance(1, 1) + covariance(2, 2));
  }
  if (e.frame.tracking_rmse) {
    line << std::fixed << std::setprecision(1) << ", " << *e.frame.tracking_rmse
         << " grey levels off";
  }
  if (e.frame.is_keyframe) line << ", a keyframe";
  if (e.events.refusal) line << ", start refused: " << *e.events.refusal;
  return line.str();
}

void bindPose(nb::class_<Estimate>& type) {
  type.def_prop_ro(
          "T_world_cam",
          [](const Estimate& e) { return matrixOf(e.frame.T_world_cam); },
          nb::rv_policy::automatic,
          "(4, 4): camera to world; None: there is no pose.")
      .def_prop_ro(
          "keyframe",
          [](const Estimate& e) -> std::optional<int> {
            if (!e.frame.keyframe) return std::nullopt;
            return e.frame.keyframe->value;
          },
          "Id of the keyframe it was tracked against.")
      .def_prop_ro(
          "T_cam_keyframe",
          [](const Estimate& e) { return matrixOf(e.frame.T_cam_keyframe); },
          nb::rv_policy::automatic,
          "(4, 4): pose relative to that keyframe, before any adjustment.")
      .def_prop_ro(
          "covariance",
          [](const Estimate& e) { return covarianceOf(e.frame.covariance); },
          nb::rv_policy::automatic,
          "(6, 6): of a left increment of T_cam_keyframe, [translation; rotation], in the "
          "segment's unit and rad; None: there is none.")
      .def_prop_ro(
          "world_covariance",
          [](const Estimate& e) { return covarianceOf(e.frame.world_covariance); },
          nb::rv_policy::automatic,
          "(6, 6): of a left increment of T_cam_world as tracked, in the gauge in which the "
          "window's keyframes taken together are not moved, turned or scaled; None: there is "
          "none.");
}

void bindEstimate(nb::module_& m) {
  nb::class_<Estimate> type(m, "Estimate", "Of one frame, after it was processed.");
  bindPose(type);
  bindRepr(type, {"id", "timestamp", "state", "segment"});
  type.def("__str__", &lineOf);
  type.def_ro("id", &Estimate::id)
      .def_ro("timestamp", &Estimate::timestamp)
      .def_prop_ro(
          "state",
          [](const Estimate& e) { return name(e.frame.state); },
          "initializing, initialized, tracked, missed (no pose, the map stands) or lost.")
      .def_prop_ro("segment", [](const Estimate& e) { return e.frame.segment; })
      .def_prop_ro("is_keyframe", [](const Estimate& e) { return e.frame.is_keyframe; })
      .def_prop_ro(
          "brightness",
          [](const Estimate& e) { return std::make_pair(e.frame.affine.a, e.frame.affine.b); },
          "Log gain [-] and offset [grey levels].")
      .def_prop_ro(
          "tracking_rmse", [](const Estimate& e) { return e.frame.tracking_rmse; }, "[grey levels]")
      .def_prop_ro(
          "repeats",
          [](const Estimate& e) {
            return e.frame.repeats ? std::optional(e.frame.repeats->value) : std::nullopt;
          },
          "Id of the earlier frame with the same image, whose answer this is.")
      .def_prop_ro(
          "keyframes",
          [](const Estimate& e) { return &e.events.keyframes; },
          nb::rv_policy::reference_internal,
          "Keyframes that are new, changed or final since the call before, in this order.")
      .def_prop_ro(
          "initialization",
          [](const Estimate& e) {
            return e.events.initialization ? &*e.events.initialization : nullptr;
          },
          nb::rv_policy::reference_internal,
          nb::sig("def initialization(self) -> Initialization | None"),
          "The start, with the poses of the frames before; None unless this frame made it.")
      .def_prop_ro(
          "refusal",
          [](const Estimate& e) { return e.events.refusal; },
          "Why the window refused a start with this frame; or None.");
}

void bindReport(nb::module_& m) {
  nb::class_<Report> type(m, "Report", "Of a whole run.");
  bindRepr(type, {"frames_given", "frames_tracked", "frames_missed", "segments"});
  type.def_prop_ro("frames_given", [](const Report& r) { return r.odometry.frames_given; })
      .def_prop_ro("frames_tracked", [](const Report& r) { return r.odometry.frames_tracked; })
      .def_prop_ro("frames_missed", [](const Report& r) { return r.odometry.frames_missed; })
      .def_prop_ro("segments", [](const Report& r) { return r.odometry.segments; })
      .def_prop_ro("keyframe_count", [](const Report& r) { return r.odometry.keyframes; })
      .def_ro("keyframes", &Report::keyframes, "The last ones, which are final now.");
}

}  // namespace

void bindOdometry(nb::module_& m) {
  bindKeyframe(m);
  bindEstimate(m);
  bindReport(m);
  nb::class_<LockedOdometry> type(m, "Odometry", "Direct visual odometry, one frame at a time.");
  bindMaker(type,
            "`initializer`: orb (default) or coarse. Options as dictionary or keywords with the "
            "names of configs/default.yaml: Odometry(camera, window={'max_keyframes': 5}). Raises "
            "ConfigError.");
  bindFeeder(type,
             "process",
             &LockedOdometry::process,
             "Gives the next rectified image, (height, width) of uint8 or float32, in time order. "
             "After `lost`, restart() comes first.");
  bindRepr(type, {});
  type.def("restart",
           &LockedOdometry::restart,
           "Leaves the state lost: the next frame starts a new segment. Returns keyframes that are "
           "final now.")
      .def("finish", &LockedOdometry::finish, "Ends the run; further frames raise RuntimeError.");
}

}  // namespace dsorb::python
