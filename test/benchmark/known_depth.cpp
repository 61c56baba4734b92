// SPDX-License-Identifier: BSD-3-Clause
// known_depth SEQUENCE EVERY SIGMA [ATE]: starts from every EVERY-th image of a sequence with
// depth/ (16-bit millimetres) and groundtruth.txt, without and with known depths that have errors
// of SIGMA [-], as they are and wrong in several ways, and prints a line for each:
//   first  depths  frames_given  direction_deg  depth_error  scale_error  scale_sigma  used
//   inflation  ate  direction_same_deg
// and at the end medians. With ATE, the odometry then tracks 40 frames. The last column is the
// direction of a start from two images, the second that with which the start without depths came.
#include "support/known_depth.h"

#include "dsorb/odometry/odometry.h"

#include <Eigen/Geometry>
#include <fmt/core.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr int kTracked = 40;  // frames of the odometry
constexpr int kMaxFrames = 60;
constexpr double kRadians = M_PI / 180;

/// Root mean square of positions after the best similarity, over the way's length [-].
double ateOf(const std::vector<std::pair<std::size_t, SE3>>& poses, const DepthSequence& sequence) {
  if (poses.size() < 5) return NAN;
  Eigen::Matrix3Xd found(3, poses.size());
  Eigen::Matrix3Xd truth(3, poses.size());
  double length = 0;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(k);
    found.col(at) = poses[k].second.translation();
    truth.col(at) = sequence.T_world_cam[poses[k].first].translation();
    if (k > 0) length += (truth.col(at) - truth.col(at - 1)).norm();
  }
  const Eigen::Matrix4d T = Eigen::umeyama(found, truth, true);
  const Eigen::Matrix3Xd errors =
      (T.topLeftCorner<3, 3>() * found).colwise() + T.topRightCorner<3, 1>() - truth;
  return std::sqrt(errors.squaredNorm() / static_cast<double>(poses.size())) / length;
}

double trackFrom(const DepthSequence& sequence, const std::vector<FramePtr>& frames) {
  OdometryOptions options;
  options.brightness = sequence.brightness;
  Odometry odometry(sequence.camera, options);
  std::vector<std::pair<std::size_t, SE3>> poses;
  for (const FramePtr& frame : frames) {
    const FrameEstimate estimate = odometry.process(frame);
    if (estimate.T_world_cam) {
      poses.emplace_back(static_cast<std::size_t>(frame->id().value), *estimate.T_world_cam);
    }
    if (poses.size() >= kTracked) break;
  }
  return poses.size() < kTracked ? NAN : ateOf(poses, sequence);
}

FramePtr frameOf(const DepthSequence& sequence,
                 std::size_t i,
                 const DepthErrors& wrong,
                 double sigma) {
  return wrong.known || wrong.turn_sigma > 0 ? withDepth(sequence, i, wrong, sigma)
                                             : sequence.frames[i];
}

/// Error of the direction with two images [deg]; NaN where there is no start.
double directionOfTwo(const DepthSequence& sequence,
                      std::size_t first,
                      std::size_t second,
                      const DepthErrors& wrong,
                      double sigma) {
  const auto initializer = makeInitializer(InitializerOptions(), sequence.camera);
  DepthStart outcome;
  for (const std::size_t i : {first, second}) {
    const InitStep step = initializer->addFrame(frameOf(sequence, i, wrong, sigma));
    if (step.result) compare(*step.result, sequence, outcome);
  }
  return outcome.direction;
}

DepthStart startFrom(const DepthSequence& sequence,
                     std::size_t first,
                     const DepthErrors& wrong,
                     double sigma,
                     bool ate) {
  const auto initializer = makeInitializer(InitializerOptions(), sequence.camera);
  DepthStart outcome;
  std::vector<FramePtr> frames;
  for (std::size_t i = first; i < std::min(sequence.frames.size(), first + kMaxFrames); ++i) {
    frames.push_back(frameOf(sequence, i, wrong, sigma));
    const InitStep step = initializer->addFrame(frames.back());
    if (!step.result) continue;
    checkInvariants(*step.result);
    outcome.frames = static_cast<double>(i - first + 1);
    compare(*step.result, sequence, outcome);
    if (ate) {
      for (std::size_t k = i + 1; k < std::min(sequence.frames.size(), i + 1 + kTracked + 20);
           ++k) {
        frames.push_back(sequence.frames[k]);
      }
      outcome.ate = trackFrom(sequence, frames);
    }
    break;
  }
  return outcome;
}

int run(int argc, char** argv) {
  if (argc < 4) {
    fmt::print(stderr, "usage: known_depth SEQUENCE EVERY SIGMA [ATE]\n");
    return 2;
  }
  const DepthSequence sequence = readDepthSequence(argv[1]);
  const auto every = static_cast<std::size_t>(std::atoi(argv[2]));
  const double sigma = std::atof(argv[3]);
  const std::vector<DepthErrors> kinds = {
      {"none", false},
      {"right"},
      {"small", true, std::sqrt(.1)},
      {"outliers", true, 1, .05},
      {"mirrored", true, 1, 0, true},
      {"sparse", true, 1, 0, false, 8},
      {"turn.01", false, 1, 0, false, 1, kRadians * .01},
      {"turn.1", false, 1, 0, false, 1, kRadians * .1},
      {"turn.1_small", false, 1, 0, false, 1, kRadians * .1, .1},
      {"pose", false, 1, 0, false, 1, kRadians * .01, 1, .02},
      {"pose_small", false, 1, 0, false, 1, kRadians * .01, .1, .02},
      {"pose_back", false, 1, 0, false, 1, kRadians * .01, 1, .02, true}};
  std::map<std::size_t, std::size_t> newest;  // of the start without depths, by the first image
  for (const DepthErrors& wrong : kinds) {
    std::map<std::string, std::vector<double>> all;
    int never = 0, wrong_starts = 0, used = 0, starts = 0;
    for (std::size_t first = 0; first + 20 < sequence.frames.size(); first += every) {
      const DepthStart o = startFrom(sequence, first, wrong, sigma, argc > 4);
      if (!wrong.known && wrong.turn_sigma == 0 && o.frames > 0) {
        newest[first] = first + static_cast<std::size_t>(o.frames) - 1;
      }
      const double same = wrong.known && newest.count(first) > 0
                              ? directionOfTwo(sequence, first, newest[first], wrong, sigma)
                              : NAN;
      fmt::print("{} {} {} {:.2f} {:.4f} {:.4f} {:.4f} {} {:.2f} {:.5f} {:.2f}\n",
                 first,
                 wrong.name,
                 o.frames,
                 o.direction,
                 o.depth,
                 o.scale,
                 o.sigma,
                 o.used,
                 o.inflation,
                 o.ate,
                 same);
      if (!(o.frames > 0)) {
        ++never;
        continue;
      }
      ++starts;
      used += o.used > 0 ? 1 : 0;
      wrong_starts += o.direction > 10 ? 1 : 0;
      all["frames"].push_back(o.frames);
      all["direction"].push_back(o.direction);
      all["depth"].push_back(o.depth);
      if (std::isfinite(o.scale)) all["scale"].push_back(std::abs(o.scale));
      if (std::isfinite(o.scale)) all["scale_sigmas"].push_back(std::abs(o.scale) / o.sigma);
      if (std::isfinite(o.ate)) all["ate"].push_back(o.ate);
      if (std::isfinite(same)) all["direction_same"].push_back(same);
    }
    fmt::print(
        "= {}: starts {} never {} wrong {} used {}", wrong.name, starts, never, wrong_starts, used);
    for (const auto& [name, values] : all) {
      fmt::print(" {} {:.4f} ({})", name, medianOf(values), values.size());
    }
    fmt::print("\n");
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace
}  // namespace dsorb

int main(int argc, char** argv) {
  try {
    return dsorb::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
