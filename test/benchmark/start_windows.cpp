// SPDX-License-Identifier: BSD-3-Clause
// start_windows SEQUENCE [reverse]: judges every window of a sequence that has a groundtruth.txt: a
// reference every fifth frame, at each of its ages. Prints what the gate of `orb` makes of a window
// and the true error of its direction, one line each:
//   reference target frames tracks corners error_probability plane_probability
//   direction_sigma_deg second_sigma_deg misfit depth_sigma parallax_deg direction_error_deg
#include "dsorb/init/initializer.h"
#include "dsorb/io/sequence_reader.h"

#include "base/parallel.h"
#include "init/orb/reference_pool.h"
#include "init/orb/start/essential_start.h"
#include "init/reset_log.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace dsorb::init_orb {
namespace {

struct StampedPose {
  double time = 0;
  Eigen::Vector3d position{0, 0, 0};
  Eigen::Quaterniond R_world_cam{1, 0, 0, 0};
};

std::vector<StampedPose> readTruth(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be read");
  std::vector<StampedPose> poses;
  for (std::string line; std::getline(file, line);) {
    StampedPose pose;
    double x = 0, y = 0, z = 0, qx = 0, qy = 0, qz = 0, qw = 0;
    if (std::sscanf(line.c_str(),
                    "%lf %lf %lf %lf %lf %lf %lf %lf",
                    &pose.time,
                    &x,
                    &y,
                    &z,
                    &qx,
                    &qy,
                    &qz,
                    &qw) != 8) {
      continue;
    }
    pose.position = {x, y, z};
    pose.R_world_cam = Eigen::Quaterniond(qw, qx, qy, qz).normalized();
    poses.push_back(pose);
  }
  if (poses.size() < 2) throw std::runtime_error(path + ": fewer than two poses");
  return poses;
}

SE3 T_world_cam(const std::vector<StampedPose>& truth, double time) {
  const auto later = [](const StampedPose& pose, double t) { return pose.time < t; };
  auto next = std::lower_bound(truth.begin() + 1, truth.end() - 1, time, later);
  const StampedPose& a = *(next - 1);
  const StampedPose& b = *next;
  const double share = std::clamp((time - a.time) / (b.time - a.time), 0.0, 1.0);
  return {a.R_world_cam.slerp(share, b.R_world_cam),
          a.position + share * (b.position - a.position)};
}

double directionErrorDeg(const InitialMap& map, const std::vector<StampedPose>& truth) {
  const SE3 T_cur_ref = T_world_cam(truth, map.frames.back().frame->timestamp()).inverse() *
                        T_world_cam(truth, map.frames.front().frame->timestamp());
  const Eigen::Vector3d& expected = T_cur_ref.translation();
  const Eigen::Vector3d& found = map.frames.back().T_cam_ref->translation();
  return 180 / M_PI * std::atan2(found.cross(expected).norm(), found.dot(expected));
}

void judgeWindow(const ReferenceView& view,
                 const AttemptContext& context,
                 const std::vector<StampedPose>& truth) {
  Attempt start = startFromEssential(view, context);
  if (!start.made) return;
  const InitialMap& map = start.made->map;
  const GateReport& gate = *start.summary.gate;
  fmt::print("{} {} {} {} {} {:.6f} {:.6f} {:.4f} {:.4f} {:.4f} {:.5f} {:.3f} {:.4f}\n",
             view.frames.front()->id().value,
             view.frames.back()->id().value,
             view.frames.size(),
             start.made->live.count,
             map.corners.size(),
             gate.error_probability,
             gate.plane_probability,
             gate.direction_sigma_deg,
             gate.second_sigma_deg,
             gate.misfit,
             gate.depth_sigma,
             gate.parallax_deg,
             directionErrorDeg(map, truth));
}

/// Options of `orb` whose gate lets everything through that it can judge.
InitializerOptions openGate() {
  InitializerOptions options = initializerVariant("orb");
  options.orb.gate.max_wrong_probability = 1;
  options.orb.gate.max_depth_sigma = 10;
  options.orb.reference_interval = 5;
  return options;
}

void judgeAll(SequenceReader& reader, const std::vector<StampedPose>& truth) {
  const InitializerOptions options = openGate();
  const PinholeCamera camera = reader.camera();
  StageClock clock;
  const AttemptContext context{camera, options, clock};
  ReferencePool pool(options.orb, options.max_waiting_mb);
  while (const std::optional<SequenceFrame> next = reader.next()) {
    if (!pool.empty()) pool.advance(next->frame);
    if (pool.empty() || pool.dropLost()) {
      pool.start(next->frame);
      continue;
    }
    for (int reference = 0; reference < pool.references(); ++reference) {
      if (pool.age(reference) >= options.orb.min_frames) {
        judgeWindow(pool.view(reference), context, truth);
      }
    }
    if (pool.giveUp(InitReason::kSettling)) {
      pool.start(next->frame);
    } else {
      pool.addWhenDue();
    }
  }
}

int run(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: start_windows SEQUENCE [reverse]\n");
    return 2;
  }
  SequenceOptions sequence;
  sequence.path = argv[1];
  sequence.reverse = argc > 2 && std::string(argv[2]) == "reverse";
  const std::vector<StampedPose> truth = readTruth(sequence.path + "/groundtruth.txt");
  SequenceReader reader(sequence);
  TaskArena arena(1);
  arena.run([&] { judgeAll(reader, truth); });
  return 0;
}

}  // namespace
}  // namespace dsorb::init_orb

int main(int argc, char** argv) {
  try {
    return dsorb::init_orb::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
