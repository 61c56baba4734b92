// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "init/orb/tracks/learned_features.h"

#include <opencv2/dnn.hpp>

#include <string>
#include <vector>

namespace dsorb::init_orb {
namespace {

const std::vector<cv::String> kOutputs = {"descriptors", "keypoints", "reliability"};
constexpr int kTrialSize = 64;  // of the image that shows whether a file is a feature network [px]

/// Runs a network; the outputs by kOutputs.
std::vector<cv::Mat> run(cv::dnn::Net& network, const cv::Mat& input) {
  const std::vector<int> shape = {1, 1, input.rows, input.cols};
  network.setInput(cv::Mat(shape, CV_32F, input.data), "image");
  std::vector<cv::Mat> outputs;
  network.forward(outputs, kOutputs);
  return outputs;
}

/// @return whether the outputs are maps of such an image
bool fits(const std::vector<cv::Mat>& outputs, const cv::Mat& input) {
  for (const cv::Mat& output : outputs) {
    if (output.dims != 4 || output.type() != CV_32F ||
        output.size[2] * kLearnedCell != input.rows ||
        output.size[3] * kLearnedCell != input.cols) {
      return false;
    }
  }
  return outputs.size() == kOutputs.size() && outputs[0].size[1] > 0 &&
         outputs[1].size[1] == kLearnedCell * kLearnedCell + 1 && outputs[2].size[1] == 1;
}

class LearnedFinder final : public FeatureFinder {
 public:
  explicit LearnedFinder(const cv::dnn::Net& network) : network_(network) {}

  Features find(const GreyImage& image) override {
    const cv::Mat input = networkInput(image.grey);
    const std::vector<cv::Mat> outputs = run(network_, input);
    LearnedMaps maps{input.cols / kLearnedCell, input.rows / kLearnedCell, {}, {}, {}};
    maps.descriptors = outputs[0].reshape(1, outputs[0].size[1]);
    maps.keypoints = outputs[1].reshape(1, outputs[1].size[1]);
    maps.reliability = outputs[2].reshape(1, 1);
    return readFeatures(maps, image, kMaxFeatures);
  }

 private:
  cv::dnn::Net network_;
};

}  // namespace

bool builtWithDnn() {
  return true;
}

std::unique_ptr<FeatureFinder> makeLearnedFinder(const std::string& file) {
  std::string reason =
      "expected outputs descriptors, keypoints (65 channels) and reliability, one "
      "element for 8x8 pixels of the input image";
  try {
    cv::dnn::Net network = cv::dnn::readNetFromONNX(file);
    network.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    const cv::Mat trial = cv::Mat::zeros(kTrialSize, kTrialSize, CV_32F);
    if (fits(run(network, trial), trial)) return std::make_unique<LearnedFinder>(network);
  } catch (const cv::Exception& error) {
    reason = error.err;
  }
  throw IoError(file + ": no network of features (scripts/export_xfeat.py writes one): " + reason);
}

}  // namespace dsorb::init_orb
