// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/opencv_flow.h"

#include <opencv2/video/tracking.hpp>

namespace dsorb::init_orb {
namespace {

constexpr double kGradientUnit = 1024;  // OpenCV's squared gradients are smaller by it

}  // namespace

std::vector<unsigned char> followWithOpenCv(const cv::Mat& from,
                                            const cv::Mat& to,
                                            const std::vector<cv::Point2f>& start,
                                            const LucasKanadeOptions& options,
                                            std::vector<cv::Point2f>& end) {
  std::vector<unsigned char> found;
  if (start.empty()) return found;
  const int flags = end.empty() ? 0 : static_cast<int>(cv::OPTFLOW_USE_INITIAL_FLOW);
  const cv::TermCriteria stop(
      cv::TermCriteria::COUNT + cv::TermCriteria::EPS, options.max_iterations, options.min_step);
  cv::calcOpticalFlowPyrLK(from,
                           to,
                           start,
                           end,
                           found,
                           cv::noArray(),
                           {options.window, options.window},
                           options.max_level,
                           stop,
                           flags,
                           options.min_eigenvalue / kGradientUnit);
  return found;
}

}  // namespace dsorb::init_orb
